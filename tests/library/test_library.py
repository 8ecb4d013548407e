"""The library: the same estimates in this process as with workers, arrays and frames, several people."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import gepf
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.template import human, human_of
from tests.support.pairs import pair
from tests.support.people import CAMERA, SETTINGS, STANDING, as_bytes, changed, shown
from tests.support.refusals import refused
from tests.support.small_sequence import write_small_sequence

ROOT = Path(__file__).parents[2]
PERSON = Measures.of(1.82)
MATRIX = [[CAMERA.fx, 0.0, CAMERA.cx], [0.0, CAMERA.fy, CAMERA.cy], [0.0, 0.0, 1.0]]


FRAME = shown("standing").frames[0]
(VIEW,) = FRAME.views


def track_two(*changes: dict[str, Any]) -> None:
    """Track the frame with each of these changes, one after another."""
    tracker = gepf.Tracker(PERSON, SETTINGS, start=STANDING)
    for change in changes:
        tracker.track(changed(FRAME, **change))


def track_views(*views: gepf.View) -> None:
    """Track a frame of these images."""
    gepf.Tracker(PERSON, SETTINGS, start=STANDING).track(gepf.Frame(0, 0.0, views))


def test_a_frame_that_was_refused_may_be_corrected() -> None:
    """Nothing of it is kept."""
    tracker = gepf.Tracker(PERSON, SETTINGS, start=STANDING)
    with refused("give uint16 of shape"):
        tracker.track(changed(FRAME, intrinsics=replace_lens(width=8)))
    assert tracker.track(FRAME).status == "tracked"


def replace_lens(**values: float) -> gepf.Intrinsics:
    """The camera with another lens."""
    return msgspec.structs.replace(CAMERA, **values)


def test_a_persons_model_is_tracked_as_a_person() -> None:
    """Given as a model or as measures: with the same degrees of freedom, and typical poses."""
    model, measures = (gepf.Tracker(body, SETTINGS) for body in (human(1.82), PERSON))
    ours, theirs = (tracker.track(FRAME) for tracker in (model, measures))
    assert ours.flexible.family == theirs.flexible.family == "human"
    np.testing.assert_array_equal(ours.joint_positions, theirs.joint_positions)
    with refused("give Measures"):
        gepf.Tracker(replace(human(1.82), vertices=human(1.82).vertices[:9]), SETTINGS)


def test_workers_give_the_same_bytes() -> None:
    """Two worker processes give the same estimates as this process alone."""
    frames = shown("standing").frames
    alone = gepf.Tracker(PERSON, SETTINGS, start=STANDING)
    said = [as_bytes(alone.track(frame)) for frame in frames]
    with gepf.Tracker(PERSON, SETTINGS, workers=2, start=STANDING) as tracker:
        assert [as_bytes(tracker.track(frame)) for frame in frames] == said


def test_arrays_are_tracked_as_frames_are() -> None:
    """Whole units with their scale give the bytes of the frames they are from; metres nearly the same."""
    frames = shown("standing").frames[:2]
    by_frame = gepf.Tracker(PERSON, SETTINGS, start=STANDING)
    assert by_frame.size == (PERSON.stature, PERSON.girth)
    by_array = gepf.Tracker(PERSON, SETTINGS, start=STANDING, camera=MATRIX, depth_scale=1000.0)
    for frame in frames:
        units = by_frame.track(frame)
        assert as_bytes(by_array.track(frame.views[0].depth)) == as_bytes(units)
    in_metres = gepf.Tracker(PERSON, SETTINGS, start=STANDING, camera=MATRIX, depth_scale=1000.0)
    metres = [in_metres.track(frame.views[0].metres(), time_s=frame.time_s) for frame in frames][-1]
    assert metres.time_s == frames[-1].time_s
    np.testing.assert_allclose(metres.joint_positions, units.joint_positions, atol=1e-3)


def test_a_body_may_be_given_whole() -> None:
    """A model with all its degrees of freedom: those named are tracked, the others stay at the start."""
    moving = ("l_shoulder_flexion", "l_elbow_flexion")
    tracker = gepf.Tracker(human_of(PERSON), SETTINGS, start=STANDING, active=moving)
    estimates = [tracker.track(frame) for frame in shown("standing").frames]
    assert tracker.model.dof_names == moving
    assert tracker.size == pytest.approx((1.82, 1.0))
    joints = np.array([e.joint_positions for e in estimates])
    assert np.linalg.norm(joints - shown("standing").joints, axis=-1).max() < 0.05


OPEN = gepf.Pool(0, listen="tcp/0.0.0.0:7447")


@pytest.mark.parametrize(
    ("mistake", "says"),
    [
        (lambda: gepf.Tracker("nobody.urdf"), "no such file: nobody.urdf; give human"),
        (lambda: gepf.Tracker(PERSON, workers=0), "workers=0.*give None, 1 or more, or a Pool"),
        (lambda: gepf.Tracker(PERSON, workers="nowhere"), "nowhere"),
        (lambda: gepf.Tracker(PERSON, active=("elbow",)), "unknown degree of freedom 'elbow'"),
        (lambda: gepf.Tracker(PERSON).track(np.ones((4, 4))), "camera"),
        (lambda: gepf.Tracker(PERSON, camera=MATRIX).track(np.ones((4, 4), int)), "depth_scale"),
        (lambda: gepf.live("key"), "give listen=ENDPOINT or connect=ENDPOINT"),
        (lambda: gepf.live("key", listen="tcp/0.0.0.0:7447"), "listen=.* accepts anyone.*insecure=True"),
        (lambda: gepf.live("key", connect="tcp/host:7447"), "connect=.* is not enc.*, or insecure=True"),
        (lambda: gepf.Tracker(PERSON, workers="tcp/host:7447"), r"connect=.* is not enc.*or workers=Pool"),
        (lambda: gepf.Tracker(PERSON, workers=OPEN), r"listen=.* accepts anyone.*Pool\(.*insecure=True\)"),
        (lambda: gepf.live("key", connect="tls/host:7447"), r"connect=.* add tls=TlsFiles\(ca, cert, key\)"),
        (lambda: gepf.live("key", connect="tls/host:1", tls=gepf.TlsFiles("a", "b")), "tls.key missing"),
        (lambda: gepf.live("key", listen="tcp/127.0.0.1:1", idle_timeout=0.0), "would end at once"),
        (
            lambda: track_two({"depth": VIEW.depth[1:]}),
            r"frame 0: depth is uint16 of shape .*; give uint16 of shape",
        ),
        (lambda: track_two({"depth": VIEW.metres()}), "depth is float32 of shape .* give uint16"),
        (lambda: track_two({"depth_scale": 0.0}), "the depth scale must be"),
        (lambda: track_two({"time_s": np.nan}), "time_s is nan; give seconds"),
        (lambda: track_two({"T_rig_camera": 2.0 * np.eye(4)}), "T_rig_camera is not a rigid transform"),
        (lambda: track_views(VIEW, replace(VIEW, camera="b", time_s=np.inf)), "of camera 'b': time_s"),
        (
            lambda: track_views(VIEW, VIEW),
            "two images with the same camera name; give each camera its own name",
        ),
        (track_views, "frame 0 has no image; give it one view per camera"),
        (lambda: track_two({}, {"intrinsics": replace_lens(fx=1.0)}), "its intrinsics differ from those"),
        (lambda: gepf.PeopleTracker(0), "would track no one"),
        (lambda: gepf.PeopleTracker(2).save([], "nowhere"), "no person to save"),
    ],
)
def test_mistakes_are_refused_in_one_line(mistake: Callable[[], object], says: str) -> None:
    """One line says what is wrong and what to give, before any port is opened."""
    with refused(says):
        mistake()


def test_the_example_runs(tmp_path: Path) -> None:
    """As its users run it: a line for each frame, with the start that comes with the sequence."""
    write_small_sequence(tmp_path / "seq", 3)
    done = subprocess.run(
        [sys.executable, "-m", "examples.library", str(tmp_path / "seq"), "2"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == [
        "frame 0, tracked",
        "frame 1, tracked",
    ]


def test_two_people_are_tracked_and_saved(tmp_path: Path) -> None:
    """A list of estimates a frame; each person's run is loaded again."""
    first, _ = pair()
    with gepf.PeopleTracker(2, SETTINGS) as tracker:
        frames = list(tracker.follow(first.frames[:3]))
        assert tracker.found == 2
        folders = tracker.save(frames, tmp_path / "run")
    assert [len(estimates) for estimates in frames] == [2, 2, 2]
    runs = [gepf.load(folder) for folder in folders]
    for place, run in enumerate(runs):
        np.testing.assert_array_equal(run.joint("head")[2], frames[2][place].joint("head"))
    apart = runs[0].joint("pelvis") - runs[1].joint("pelvis")
    assert np.linalg.norm(apart, axis=1) == pytest.approx(1.02, abs=0.06)
