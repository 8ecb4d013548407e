"""A run's file for the viewer has the tracked and the observed data."""

from __future__ import annotations

import json
import os
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from gepf.common.activation import activate
from gepf.common.body import with_shape
from gepf.common.protocol.frames import encode_live
from gepf.common.protocol.models import encode_model
from gepf.common.transport.opening import open_worker
from gepf.coordinator.cli import main
from gepf.coordinator.commands.view import LiveScene
from gepf.coordinator.results.configuration import PATH
from gepf.coordinator.results.live_results import LiveResults, PackedOutlet
from gepf.coordinator.results.track import read_track, read_tracked_body
from gepf.coordinator.sources import open_source
from gepf.coordinator.synthesis.scenes import ARM_DOFS, SCENES
from gepf.coordinator.synthesis.sequence import synthesise
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.estimate import Estimate
from tests.support.live import KEY, plate_image
from tests.support.processes.programs import in_thread
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
    write_run(run, body, scene.poses[:FRAMES, moving], frames=np.arange(FRAMES) - 100)  # 100 is added
    return sequence, run


def rows_of(file: Path) -> Counter[str]:
    """Rows by entity that change over time."""
    rows: Counter[str] = Counter()
    for chunk in RrdReader(str(file)).stream():
        if not chunk.is_static:
            rows[str(chunk.entity_path)] += chunk.num_rows
    return rows


def test_every_frame_is_in_the_recording(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    """Model, hypotheses, depth and angles have a row a frame."""
    sequence, run = recorded
    file = tmp_path / "run.rrd"
    assert main(["view", str(run), "--sequence", str(sequence), "--save", str(file)]) == 0
    rows = rows_of(file)
    places = ["/model/surface", "/model/skeleton", "/hypotheses", "/camera/image/depth", "/angles"]
    assert {place: rows[place] for place in places} == dict.fromkeys(places, FRAMES)
    assert rows["/status"] == 1


@pytest.mark.parametrize("shapes", [0, 1], ids=["known size", "estimated size"])
def test_live_frames_and_results_are_shown_as_they_come(
    recorded: tuple[Path, Path], endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shapes: int
) -> None:
    """Depth, body and hypotheses of what others publish are written until the results end.

    A body whose size changes is fetched once, and shown in the shape of each result.
    """
    track, model = read_track(recorded[1]), read_tracked_body(recorded[1]).model
    if shapes:
        rest = model.vertices, model.points, model.joint_points
        model = with_shape(model, ("scale",), np.ones(1), *(points[None] for points in rest))
    fetched = threading.Event()

    def fetch(_: object) -> bytes:
        fetched.set()
        return encode_model(model)

    def publish(stop: threading.Event) -> None:
        with open_worker([endpoint]) as bus:
            bus.serve(f"gepf/run/room/r/model/{model.hash}", fetch)
            camera, results = bus.publish(KEY), bus.publish(f"{KEY}/results")
            while not (camera.has_subscriber and results.has_subscriber) and not stop.wait(0.01):
                pass
            for f, frame in enumerate(open_source(recorded[0])):
                camera.put_blocking(encode_live(frame.views[0]))
                pose = track.pose[f]
                joints = track.joint_positions[f]
                certainty = unknown_certainty(len(joints))
                known = Estimate(f, 0.0, "tracked", pose, joints, pose[None], np.ones(1), 0.0, certainty)
                shape = np.full(shapes, 0.1 * f)
                LiveResults(PackedOutlet(results), run="room/r").put(known, model, {}, shape)
                fetched.wait(2.0)  # so that the body is known when a later frame is shown
            LiveResults(PackedOutlet(results)).end()
            stop.wait()

    view = ["view", f"zenoh:{KEY}", "--listen", endpoint, "--save", str(tmp_path / "live.rrd")]
    # it takes only time that nobody else wants, of which a busy machine has none
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    with in_thread(publish):
        assert main(view) == 0
    rows = rows_of(tmp_path / "live.rrd")
    places = ["/model/surface", "/model/doubtful", "/hypotheses", "/camera/image/depth"]
    assert all(0 < rows[place] <= FRAMES for place in places)


def test_what_a_live_view_lacks_is_said_once() -> None:
    """No publisher; then frames, but no tracker that publishes results."""
    said, shown = list[str](), list[tuple[str, bytes]]()
    scene = LiveScene(lambda: shown, list, said.append, notice=0.3)
    for number in range(8):
        shown[:] = [(KEY, encode_live(plate_image(number)))] * (number > 3)
        assert scene.take_results() == {}
    assert [line.split(";")[0] for line in said] == ["no frame arrives", "frames arrive, but no results"]
    assert scene.image(7) is not None


def test_a_moved_sequence_is_a_warning(
    recorded: tuple[Path, Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """If the sequence is missing, only the model is shown, and a line says what to do."""
    _, run = recorded
    (run / "summary.json").write_text(json.dumps({PATH: str(tmp_path / "gone")}))
    file = tmp_path / "run.rrd"
    assert main(["view", str(run), "--save", str(file)]) == 0
    assert rows_of(file)["/model/surface"] == FRAMES
    assert "/camera/image/depth" not in rows_of(file)
    assert "--sequence" in caplog.text
