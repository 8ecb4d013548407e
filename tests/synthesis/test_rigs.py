"""Rendered rigs: cameras around one scene agree in space and time with each other and with the truth."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from common.camera import back_project, project
from common.errors import InputError
from coordinator.results.evaluation import read_truth
from coordinator.sources import Source, open_source
from coordinator.synthesis.sequence import synthesise

LATE_S = 0.008


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """Three cameras, 60 degrees and 8 ms from each other, around two people in a room."""
    out = tmp_path_factory.mktemp("synth") / "rig"
    synthesise("two", out, frames=4, cameras=3, apart=60.0, late=1000.0 * LATE_S, room=True)
    return open_source(out / "rig.json")


def test_cameras_are_around_the_person_and_late(rig: Source) -> None:
    """They look at one place from one distance, and each has images 8 ms after those of the one before."""
    assert [view.camera for view in rig.views] == ["cam0", "cam1", "cam2"]
    frame = rig.frame(2)
    for n, view in enumerate(frame.views):
        assert view.time_s - frame.time_s == pytest.approx(n * LATE_S)
    ahead = [view.T_rig_camera[:3, 2] for view in rig.views]
    for one, other in pairwise(ahead):
        assert np.degrees(np.arccos(one @ other)) == pytest.approx(60.0)


def test_truth_and_images_are_one_motion(rig: Source) -> None:
    """Joints of every camera, at its times, are on one path; all see one floor, and depth at the joints."""
    paths = []
    for view in rig.views:
        assert view.truth is not None
        joints = read_truth(view.truth, np.eye(4)).joint_positions
        paths.append(joints @ view.T_rig_camera[:3, :3].T + view.T_rig_camera[:3, 3])
        for frame in view.changed(others=()):
            metres = frame.metres()
            points = back_project(metres, frame.intrinsics)[metres > 0.0]
            floor = (points @ view.T_rig_camera[:3, :3].T + view.T_rig_camera[:3, 3])[:, 1].max()
            assert floor == pytest.approx(1.0, abs=0.01)  # the camera is one metre high
            at = np.rint(project(joints[frame.number], frame.intrinsics)).astype(int)
            inside = (
                (at[:, 1] < metres.shape[0] - 1) & (at[:, 0] < metres.shape[1] - 1) & np.all(at > 0, axis=1)
            )
            behind = joints[frame.number][inside, 2] - metres[at[inside, 1], at[inside, 0]]
            assert behind.min() > -0.02
    for n, path in enumerate(paths):
        step = n * LATE_S * rig.fps
        between = (1.0 - step) * paths[0][:-1] + step * paths[0][1:]
        assert np.abs(path[:-1] - between).max() < 0.003


def test_a_rig_that_cannot_be_rendered_is_refused(tmp_path: Path) -> None:
    """One line says why."""
    with pytest.raises(InputError, match="choose 1 to"):
        synthesise("turn", tmp_path / "x", cameras=0)
