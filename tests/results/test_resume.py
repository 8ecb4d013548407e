"""Runs that end early and continue, in one process: a tracker from its state, a run from its folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest

from gepf.common.camera import back_project
from gepf.common.errors import NoWorkers
from gepf.common.frame import Frame
from gepf.coordinator.filters.methods import METHODS, settings_for
from gepf.coordinator.pool.options import Pool, PoolStatistics
from gepf.coordinator.results.log import Entry, Opening, append_records, read_log
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.particle_filter import SubmittedPerson
from gepf.coordinator.tracking.reporting import Stopwatch
from gepf.coordinator.tracking.segmenter import BodyView
from gepf.coordinator.tracking.state import TrackerState, first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.refiners import DirectRefiner
from tests.support.people import STANDING, OnePerson, as_bytes, empty, known, shown
from tests.support.rooms import in_a_room, of_box
from tests.support.stand_ins import Desk, desk, sequence, workers  # noqa: F401 fixtures


def recorded_state(file: BinaryIO, state: TrackerState, estimate: Estimate) -> TrackerState:
    """A state as it is read from the log to which it was appended."""
    (person,) = state.people
    entry = Entry(state.frame, [person.start], [person.checkpoint], [estimate], PoolStatistics(), 0.0)
    append_records(file.fileno(), [Opening({}), entry])
    recorded = read_log(Path(file.name))
    assert recorded is not None
    return recorded.state


def beside(frame: Frame) -> Frame:
    """The frame with something as large as a child, which comes nearer until it touches the person."""
    (view,) = frame.views
    rays = back_project(np.ones(view.depth.shape), view.intrinsics)
    left, z = STANDING["root_tx"] + 0.5 - 0.07 * frame.number, STANDING["root_tz"]
    thing = of_box(rays, ((left, -0.3, z - 0.1), (left + 0.5, 0.7, z + 0.3)))
    units = np.minimum(np.rint(1000.0 * thing), view.depth.astype(np.float64))
    return Frame.of(replace(view, depth=units.astype(np.uint16)))


PLACES: dict[str, Callable[[Frame], Frame]] = {
    "alone": lambda frame: frame,
    "room": in_a_room,
    "beside something": lambda frame: beside(in_a_room(frame)),
}


CASES = [*((method, "alone") for method in METHODS), ("gepf", "room"), ("gepf", "beside something")]


@pytest.mark.parametrize(("method", "place"), CASES)
def test_a_tracker_goes_on_bit_for_bit(method: str, place: str, tmp_path: Path) -> None:
    """After any frame, a new tracker from the recorded state gives the same estimates.

    The state of a room is restored from the log, and what is beside the person.
    """
    settings = settings_for(method, "default", 1 if method == "gradient" else 6, 500, seed=5)
    frames = list(shown("standing").frames)
    frames[2] = empty(2)
    frames = [PLACES[place](frame) for frame in frames]
    whole = OnePerson(DirectRefiner(), settings, known(), start=STANDING)
    said = [as_bytes(tracked.people[0].estimate) for tracked in whole.follow(frames)]

    following = OnePerson(DirectRefiner(), settings, known(), start=STANDING)
    with (tmp_path / "log").open("ab") as file:
        for number, frame in enumerate(frames):
            estimate = following.track(frame)
            assert as_bytes(estimate) == said[number]
            state = recorded_state(file, following.state, estimate)
            following = OnePerson(DirectRefiner(), settings, known(), state=state)


def test_all_that_a_target_tracker_changes_is_in_its_state() -> None:
    """Tracking changes no other attribute than those of which the state consists; a new one fails here."""
    settings = preset("default")
    target = TargetTracker(DirectRefiner(), settings, known(), first_state(known(), STANDING, settings))
    before, state = dict(vars(target)), target.state
    frame = shown("standing").frames[0]
    submitted = target.submit(BodyView(frame, isolate(frame, 1000), Planes()), Stopwatch())
    assert isinstance(submitted, SubmittedPerson)
    target.update(submitted, {})
    changed = {name for name, value in vars(target).items() if value is not before[name]}
    assert changed - {"_distance"} == {"start", "track"}  # the distance is measured in each frame anew
    assert target.state.checkpoint.generator != state.checkpoint.generator
    assert target.state.track is target.track


OPTIONS = ("--particles", "6", "--points", "300", "--seed", "3")


def test_an_interrupted_run_says_how_to_go_on_and_does(desk: Desk, tmp_path: Path) -> None:
    """Stopped twice, it ends with the bytes of an undisturbed run; counts and times cover all three parts."""
    assert desk.track(*OPTIONS, out=tmp_path / "calm") == 0
    desk.fail(1)
    assert desk.track(*OPTIONS) == 130
    *_, early, last = desk.said()
    assert early == f"ended early with 1 of 5 frames in {desk.out}; --resume continues"
    assert last == "gepf: stopped"
    desk.fail(4, NoWorkers("nobody came"))
    assert desk.track(*OPTIONS, "--resume", "--workers", "7") == 1
    assert "continuing with frame 1; 1 of 5 frames are recorded" in desk.said()
    desk.fail(None)
    assert desk.track(*OPTIONS, "--resume") == 0
    assert any("frame 5 of 5" in line for line in desk.said())
    assert desk.files()[desk.out / "track.npz"] == (tmp_path / "calm" / "track.npz").read_bytes()
    assert not (desk.out / "frames.log").exists()
    summary = desk.summary
    assert (summary["complete"], summary["frames"], summary["resumes"]) == (True, 5, 2)
    assert (summary["workers_seen"], summary["batches_sent_again"]) == (["one", "two"], 9)


@pytest.mark.parametrize("damaged", [1, 2, 4])
def test_a_damaged_frame_ends_a_run_that_can_go_on(desk: Desk, tmp_path: Path, damaged: int) -> None:
    """Exit code 2 and one line that names the file; tracked frames are kept; once repaired, it continues."""
    calm = tmp_path / "calm"
    assert desk.track(*OPTIONS, out=calm) == 0
    picture = desk.sequence / "depth" / f"{damaged:06d}.png"
    whole = picture.read_bytes()
    picture.write_bytes(whole[: len(whole) // 2])
    assert desk.track(*OPTIONS) == 2
    *_, early, last = desk.said()
    assert early.startswith(f"ended early with {damaged} of 5 frames in {desk.out}; ")
    assert last.startswith(f"gepf: {picture} is damaged")
    with np.load(desk.out / "track.npz") as kept, np.load(calm / "track.npz") as wanted:
        np.testing.assert_array_equal(kept["pose"], wanted["pose"][:damaged])
    picture.write_bytes(whole)
    assert desk.track(*OPTIONS, "--resume") == 0
    assert (desk.out / "track.npz").read_bytes() == (calm / "track.npz").read_bytes()


def test_a_run_reads_each_frame_when_it_is_its_turn(desk: Desk) -> None:
    """Until the workers have the first, only that is read; then at most one ahead, and none beyond."""
    pictures = [desk.sequence / "depth" / f"{number:06d}.png" for number in range(5)]
    whole = [picture.read_bytes() for picture in pictures]

    def bring(number: int) -> None:
        """Frame `number` is with the workers; the next may be read from now on."""
        if number < 2:
            pictures[number + 1].write_bytes(whole[number + 1])

    for picture in pictures[1:]:
        picture.write_bytes(b"")
    desk.workers.before = bring
    assert desk.track(*OPTIONS, "--frames", "0:3") == 0


def test_a_fresh_folder_is_begun_and_a_complete_one_left_alone(desk: Desk) -> None:
    """The same command can be repeated until the run is complete, and after that."""
    assert desk.track(*OPTIONS, "--resume") == 0
    assert f"nothing to resume in {desk.out}; starting with the first frame" in desk.said()
    before = desk.files()
    assert desk.track(*OPTIONS, "--resume") == 0
    assert desk.said()[1:] == [f"all 5 frames are in {desk.out} already"]
    assert desk.files() == before


def test_results_are_written_again_if_the_run_was_killed_while_writing_them(
    desk: Desk, tmp_path: Path
) -> None:
    """All frames are recorded, no worker is used, and the usual files are written."""
    out, workers = desk.out, desk.workers
    assert desk.track(*OPTIONS, out=tmp_path / "calm") == 0
    workers.before = lambda number: (out / "poses.csv").mkdir(exist_ok=True) if number == 4 else None
    assert desk.track(*OPTIONS) == 2
    (out / "poses.csv").rmdir()
    (out / "track.npz").unlink()
    desk.fail(0)
    workers.asked = Pool(run="nobody")
    desk.said()
    assert desk.track(*OPTIONS, "--resume") == 0
    assert workers.asked == Pool(run="nobody")
    assert desk.said()[1] == f"all 5 frames are recorded in {out}; writing the results"
    assert (out / "track.npz").read_bytes() == (tmp_path / "calm" / "track.npz").read_bytes()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--seed", "4"), "settings.seed (recorded 3, now 4)"),
        (("--frames", "0:4", "--init", "auto"), "frame_range (recorded 0:5, now 0:4) and 1 more"),
        (("--dof", "r_elbow_flexion"), "dof (recorded None, now r_elbow_flexion)"),
    ],
)
@pytest.mark.parametrize("fail_at", [None, 2], ids=["complete", "interrupted"])
def test_other_options_are_named(
    desk: Desk, options: tuple[str, ...], says: str, fail_at: int | None
) -> None:
    """One line names the changed options, for complete and incomplete runs, and no file is changed."""
    desk.fail(fail_at)
    desk.track(*OPTIONS)
    before = desk.files()
    desk.said()
    assert desk.track(*OPTIONS, "--resume", *options) == 2
    (line,) = [each for each in desk.said() if each.startswith("gepf: ")]
    assert f"was recorded with other options: {says}" in line
    assert line.endswith("; choose another --out")
    assert desk.files() == before


def other_camera(sequence: Path) -> None:
    """Say something else of the camera, so that the first frame is another."""
    camera = json.loads((sequence / "camera_intrinsic.json").read_text()) | {"depth_scale": 999}
    (sequence / "camera_intrinsic.json").write_text(json.dumps(camera))


@pytest.mark.parametrize("what", ["sequence", "model"])
def test_an_input_may_be_moved_but_not_changed(desk: Desk, tmp_path: Path, what: str) -> None:
    """A sequence is known by its first frame, a body by the content of its file."""
    person = tmp_path / "person.json"
    person.write_text('{"stature": 1.8}')

    def go(at: int, *options: str) -> int:
        desk.fail(at)
        return desk.track(*OPTIONS, "--model", str(person), *options)

    assert go(2) == 130
    (tmp_path / "moved").mkdir()
    desk.sequence, person = (path.rename(tmp_path / "moved" / path.name) for path in (desk.sequence, person))
    assert go(4, "--resume") == 130
    other_camera(desk.sequence) if what == "sequence" else person.write_text('{"stature": 1.7}')
    desk.said()
    assert go(4, "--resume") == 2
    assert f"{'first_frame' if what == 'sequence' else 'model.content'} (recorded" in desk.said()[-1]
