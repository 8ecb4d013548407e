"""The recording of a run for the viewer holds what was tracked and what was seen."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from common.activation import activate
from common.frame import DepthFrame
from common.kinematics import pose_vertices
from coordinator.cli import main
from coordinator.results.configuration import PATH
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import ARM_DOFS, SCENES
from coordinator.synthesis.sequence import synthesise
from coordinator.tracking.segmenter import PosedBody, Segmenter
from coordinator.viewing import correspond, ellipsoids
from tests.support.runs import write_run

FRAMES = 3


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, Path]:
    """Three frames of the arm, and a run that found the truth."""
    sequence, run = tmp_path / "arm", tmp_path / "run"
    synthesise("arm", sequence, frames=FRAMES)
    scene = SCENES["arm"]()
    body = activate(scene.model, ARM_DOFS, scene.poses[0])
    moving = [scene.model.dof(name) for name in ARM_DOFS]
    write_run(run, body, scene.poses[:FRAMES, moving])
    return sequence, run


def rows_of(file: Path) -> Counter[str]:
    """Rows by entity that change over time."""
    rows: Counter[str] = Counter()
    for chunk in RrdReader(str(file)).stream():
        if not chunk.is_static:
            rows[str(chunk.entity_path)] += chunk.num_rows
    return rows


def test_every_frame_is_in_the_recording(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    """Points, correspondences, model, hypotheses, covariance, depth and every angle have a row a frame."""
    sequence, run = recorded
    file = tmp_path / "run.rrd"
    with np.load(run / "track.npz") as saved:
        arrays = dict(saved)
    arrays["frame"] = np.arange(FRAMES)
    np.savez(run / "track.npz", **arrays)
    assert main(["view", str(run), "--sequence", str(sequence), "--save", str(file)]) == 0
    rows = rows_of(file)
    places = ["/observed/points", "/observed/correspondences", "/model/surface", "/model/skeleton"]
    places += ["/hypotheses", "/covariance", "/camera/image/depth", *(f"/angles/{name}" for name in ARM_DOFS)]
    assert {place: rows[place] for place in places} == dict.fromkeys(places, FRAMES)
    assert rows["/status"] == 1


def test_a_moved_sequence_is_a_warning(
    recorded: tuple[Path, Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Where the sequence is gone, the model alone is shown, and a line says how to mend it."""
    _, run = recorded
    (run / "summary.json").write_text(json.dumps({PATH: str(tmp_path / "gone")}))
    file = tmp_path / "run.rrd"
    assert main(["view", str(run), "--save", str(file)]) == 0
    assert rows_of(file)["/model/surface"] == FRAMES
    assert "/observed/points" not in rows_of(file)
    assert "--sequence" in caplog.text


def test_no_folder_to_save_in_is_one_line(
    recorded: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 before anything is prepared."""
    sequence, run = recorded
    file = tmp_path / "no" / "such.rrd"
    assert main(["view", str(run), "--sequence", str(sequence), "--save", str(file)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_correspondences_of_the_true_pose_are_short() -> None:
    """A body rendered in a pose lies within the surface's spacing of itself, and on the side that is seen."""
    scene = SCENES["arm"]()
    model, pose = scene.model, scene.poses[0]
    surface = pose_vertices(model, pose[None])[0]
    with DepthRenderer(scene.camera) as renderer:
        metres = renderer.depth(surface, model.triangles)
    frame = DepthFrame(0, 0.0, (metres * 1000.0).astype(np.uint16), 1000.0, scene.camera)
    found = correspond(Segmenter(500), frame, PosedBody(model, pose))
    assert found is not None
    assert len(found.observed) == 500
    assert found.residual == pytest.approx(np.linalg.norm(found.observed - found.nearest, axis=1))
    assert np.quantile(found.residual, 0.95) < 0.02


def test_ellipsoids_are_the_covariance() -> None:
    """Half axes and turns of scattered joints give back their covariance about the reported place."""
    rng = np.random.default_rng(0)
    joints = rng.normal(size=(40, 2, 3)) * [0.3, 0.1, 0.02]
    weights = rng.uniform(size=40)
    half, turns = ellipsoids(joints, np.zeros((2, 3)), weights)
    x, y, z, w = turns[0]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    expected = np.einsum("m,mi,mj->ij", weights / weights.sum(), joints[:, 0], joints[:, 0])
    assert turn @ np.diag(half[0] ** 2) @ turn.T == pytest.approx(expected)


def test_agreement_is_a_small_ball() -> None:
    """Where all hypotheses agree there is still something to see."""
    half, _ = ellipsoids(np.zeros((3, 1, 3)), np.zeros((1, 3)), np.ones(3))
    assert np.all((half > 0.0005) & (half < 0.01))
