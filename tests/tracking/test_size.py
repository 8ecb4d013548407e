"""The size of a person: shape coefficients in the state, by rendered people of known size."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.frame import Frame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.bodies.human.template import human_of
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.state import PersonState
from gepf.refiners import DirectRefiner
from tests.support.people import SETTINGS, SITTING, STANDING, OnePerson, changed, frame_of, rendered
from tests.support.rigs import around, seen_from

BODIES = choose_bodies(None, "default")
POSTURE = {**STANDING, "root_tz": 2.7}


def swaying(measures: Measures, posture: dict[str, float], frames: int) -> list[Array]:
    """Depth images (H, W), ten a second, of a person who turns and moves the arms a little."""
    body = human_of(measures)
    poses = []
    for t in np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False):
        moved = {
            **posture,
            "root_ry": posture.get("root_ry", 0.0) + 0.25 * np.sin(t),
            "l_shoulder_abduct": 0.4 + 0.3 * np.sin(2.0 * t),
            "r_shoulder_flexion": 0.4 - 0.4 * np.cos(t),
        }
        poses.append(name_pose(body, moved))
    return list(rendered(body, np.array(poses)))


def follow(frames: list[Frame], settings: Settings = SETTINGS) -> PersonState:
    """The state after frames in which a person of unknown size is detected and tracked."""
    tracker = OnePerson(DirectRefiner(), settings, BODIES)
    for frame in frames:
        estimate = tracker.track(frame)
    assert estimate.status == "tracked"
    return tracker.person


def timed(images: list[Array]) -> list[Frame]:
    """Frames of depth images, ten a second."""
    return [changed(frame_of(n, image), time_s=0.1 * n) for n, image in enumerate(images)]


def at_time(frame: Frame, n: int) -> Frame:
    """The images of all cameras as the n-th frame, ten a second."""
    return Frame.of(*(replace(view, number=n, time_s=0.1 * n) for view in frame.views))


@pytest.mark.parametrize(
    ("stature", "girth"), [(1.82, 1.0), (1.58, 0.95), (1.75, 1.3), (1.2, 1.0)], ids="{}".format
)
def test_a_person_who_stands_has_the_right_stature(stature: float, girth: float) -> None:
    """Adult, heavy adult and child; the stated deviation covers the error."""
    state = follow(timed(swaying(Measures.of(stature, girth), POSTURE, 20)))
    assert Size(*state.size).stature == pytest.approx(stature, rel=0.025)
    assert abs(Size(*state.size).stature - stature) < 3.0 * state.stature_deviation < 0.15


def test_a_person_who_sits_has_about_the_right_stature() -> None:
    """From the first frame on, and less certain than one who stands."""
    sits = follow(timed(swaying(Measures.of(1.7, 1.0), {**SITTING, "root_tz": 2.7}, 20)))
    assert Size(*sits.size).stature == pytest.approx(1.7, rel=0.06)


def test_the_stature_becomes_certain_with_time() -> None:
    """Its deviation falls from frame to frame, and the body changes less and less."""
    tracker, statures, deviations = OnePerson(DirectRefiner(), SETTINGS, BODIES), [], []
    for frame in timed(swaying(Measures.of(1.7, 1.0), POSTURE, 30)):
        tracker.track(frame)
        statures.append(Size(*tracker.person.size).stature)
        deviations.append(tracker.person.stature_deviation)
    assert np.all(np.diff(deviations) < 0.0)
    steps = np.abs(np.diff(statures))
    assert steps[-10:].mean() < steps[:10].mean()


@pytest.mark.parametrize("girth", [0.9, 1.2])
def test_cameras_on_both_sides_show_the_girth(girth: float) -> None:
    """Front and back together leave no doubt about the thickness of a body."""
    body = human_of(Measures.of(1.7, girth))
    pose = name_pose(body, POSTURE)
    frame = seen_from(body, [pose, pose], {"front": around(0.0), "back": around(180.0)})
    state = follow([at_time(frame, n) for n in range(20)])
    assert Size(*state.size).girth == pytest.approx(girth, rel=0.05)
    assert Size(*state.size).stature == pytest.approx(1.7, rel=0.025)


def test_a_size_that_is_not_wanted_is_not_measured() -> None:
    """A run without measuring keeps the body that was detected."""
    settings = msgspec.structs.replace(SETTINGS, measure_person=False)
    tracker, sizes = OnePerson(DirectRefiner(), settings, BODIES), set()
    for frame in timed(swaying(Measures.of(1.7, 1.0), POSTURE, 4)):
        tracker.track(frame)
        sizes.add(tracker.person.size)
    assert len(sizes) == 1
    assert tracker.person.stature_deviation == 0.0


def test_what_is_reported_has_no_degrees_of_freedom_of_shape() -> None:
    """Pose, hypotheses and body have the degrees of freedom that users know, and describe the same joints."""
    tracker = OnePerson(DirectRefiner(), SETTINGS, BODIES)
    for frame in timed(swaying(Measures.of(1.6, 1.0), POSTURE, 3)):
        estimate = tracker.track(frame)
    body = tracker.person.body
    assert body.dof_names[0] == "root_tx"
    assert estimate.pose.shape == (len(body.dof_names),)
    assert estimate.hypothesis_pose.shape[1] == len(body.dof_names)
    np.testing.assert_allclose(
        joint_positions(body, estimate.pose[None])[0], estimate.joint_positions, atol=1e-9
    )


def test_a_person_of_unknown_size_has_the_uncertainty_of_a_person() -> None:
    """Joints are about as uncertain as those of a person whose size does not change, not as a robot's."""
    frames = timed(swaying(Measures.of(1.7, 1.0), POSTURE, 4))
    deviations = []
    for measured in (True, False):
        settings = msgspec.structs.replace(SETTINGS, measure_person=measured)
        tracker = OnePerson(DirectRefiner(), settings, BODIES)
        estimate = [tracker.track(frame) for frame in frames][-1]
        deviations.append(np.median(estimate.certainty.deviation))
    assert deviations[0] == pytest.approx(deviations[1], rel=0.3)
