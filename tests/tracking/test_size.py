"""A person's stature by the length from head to sole, and girth by cameras on several sides; rendered."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import HIDDEN, SUBJECT, DepthFrame, SubjectFrame
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.template import human_of
from gepf.coordinator.bodies.tracked import Size, name_pose
from gepf.coordinator.filters.gradient_enhanced import begin
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.synthesis.noise import as_a_kinect
from gepf.coordinator.tracking.particle_filter import Pace, Submitted
from gepf.coordinator.tracking.person_size import PersonSize
from gepf.coordinator.tracking.refiner import Pending
from gepf.coordinator.tracking.segmenter import Segmenter
from gepf.coordinator.tracking.state import Start, TrackerState, first_state
from gepf.coordinator.tracking.stature import StatureEstimate, head_to_ankle, measure_stature
from gepf.coordinator.tracking.target import TargetTracker
from gepf.refiners import DirectRefiner
from tests.support.people import (
    CAMERA,
    SETTINGS,
    SITTING,
    STANDING,
    OnePerson,
    frame_of,
    rendered,
    shown,
    subject_of,
)
from tests.support.rigs import around, seen_from
from tests.support.rooms import in_a_room

STATURE = 1.7
POSTURE = {**STANDING, "root_tz": 2.7}
BODIES = choose_bodies(None, "default")
MODEL = BODIES.tracked(Size(STATURE, 1.0), {})[0]


def subject_in(posture: dict[str, float], camera: Intrinsics = CAMERA) -> SubjectFrame:
    """A rendered person of STATURE in a posture."""
    body = human_of(Measures.of(STATURE, 1.0))
    (depth,) = rendered(body, name_pose(body, posture)[None], camera)
    return subject_of(replace(frame_of(0, depth), intrinsics=camera), 3000)


def stature_in(
    posture: dict[str, float], scale: float = 1.0, subject: SubjectFrame | None = None
) -> float | None:
    """The stature that a frame shows of a person in a posture, by a scaled model in the same pose."""
    model = BODIES.tracked(Size(scale * STATURE, 1.0), {})[0]
    pose = name_pose(model, {n: v for n, v in posture.items() if n in model.dof_names})
    return measure_stature(model, pose, scale * head_to_ankle(MODEL), subject or subject_in(posture))


@pytest.mark.parametrize("scale", [0.94, 1.0, 1.06])
def test_the_stature_is_the_persons_and_not_the_models(scale: float) -> None:
    """A model that is too small or too large by 6 % measures it within 1 cm."""
    assert stature_in(POSTURE, scale) == pytest.approx(STATURE, abs=0.01)


def test_gaps_at_outlines_and_at_the_floor_do_not_change_the_stature() -> None:
    """A Kinect shows nothing at outlines, and a foot near the floor cannot be distinguished from it."""
    body = human_of(Measures.of(STATURE, 1.0))
    (alone,) = rendered(body, name_pose(body, POSTURE)[None])
    room = in_a_room(frame_of(0, alone)).metres().astype(np.float64)
    noisy = as_a_kinect(room, CAMERA, np.random.default_rng(0))
    (person,) = Segmenter(3000).segment(frame_of(0, noisy), [None]).candidates
    assert stature_in(POSTURE, subject=person) == pytest.approx(STATURE, rel=0.015)


@pytest.mark.parametrize("finer", [2, 3])
def test_the_stature_is_the_persons_and_not_the_cameras(finer: int) -> None:
    """A camera with more pixels measures the same, but for 1 cm."""
    width, height, focal = finer * CAMERA.width, finer * CAMERA.height, finer * CAMERA.fx
    sharp = Intrinsics(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))
    measured = stature_in(POSTURE, subject=subject_in(POSTURE, sharp))
    assert measured == pytest.approx(stature_in(POSTURE), abs=0.01)


def test_legs_apart_show_the_same_stature() -> None:
    """A person who stands astride is as tall as with the feet together."""
    astride = {**POSTURE, "l_hip_abduct": 0.25, "r_hip_abduct": 0.25}
    assert stature_in(astride) == pytest.approx(stature_in(POSTURE), abs=0.03)


def test_a_frame_without_feet_shows_no_stature() -> None:
    """Something nearer hides the feet."""
    whole = subject_in(POSTURE)
    depth = whole.frame.depth.copy()
    hidden = depth.shape[0] * 17 // 20
    depth[hidden:] = 0
    labels = np.where(depth > 0, SUBJECT, 0).astype(np.uint8)
    labels[hidden:] = HIDDEN
    cut = replace(whole, frame=replace(whole.frame, depth=depth), kinds=labels)
    assert stature_in(POSTURE, subject=cut) is None


@pytest.mark.parametrize(
    "posture",
    [{**SITTING, "root_tz": 2.7}, {**POSTURE, "r_shoulder_flexion": 2.9, "r_elbow_flexion": 0.6}],
    ids=["seated", "a raised hand"],
)
def test_some_postures_show_no_stature(posture: dict[str, float]) -> None:
    """A seated person does not, nor one with a hand that could be taken for the head."""
    assert stature_in(posture) is None


def test_the_median_of_the_first_frames_becomes_the_stature_and_stays() -> None:
    """A few odd frames change nothing; only a whole window of another stature does."""
    size, stature = StatureEstimate(), 1.8
    for frame in range(20):
        size = size.add(1.9 if frame % 5 == 0 else 1.70, 0.1 * frame)
        stature = size.revise(stature)
    assert stature == pytest.approx(1.70)
    assert size.settled
    history = []
    for frame in range(20, 60):
        size = size.add(1.60, 0.1 * frame)
        stature = size.revise(stature)
        history.append(stature)
    assert history[5] == pytest.approx(1.70)
    assert stature == pytest.approx(1.60)


def test_a_tracked_person_gets_the_right_stature_and_keeps_the_pose() -> None:
    """Measured while tracking, as well as is said; a settled stature does not change from frame to frame."""
    still = shown("standing").frames[0]
    tracker, statures = OnePerson(DirectRefiner(), SETTINGS, BODIES), []
    for n in range(20):
        estimate = tracker.track(replace(still, number=n, time_s=0.1 * n))
        statures.append(tracker.start.size.stature)
    assert abs(statures[-1] - 1.82) < 2.0 * tracker.state.stature_deviation < 0.1
    assert estimate.status == "tracked"
    assert statures[-1] == pytest.approx(1.82, abs=0.025)
    assert len(set(statures)) <= 3


@pytest.mark.parametrize(("yaws", "girth"), [((0.0,), 1.05), ((0.0, 180.0), 0.92)], ids=["one", "two"])
def test_cameras_on_both_sides_show_the_girth(yaws: tuple[float, ...], girth: float) -> None:
    """Within 3 % when the stature is revised; one camera keeps the girth that was detected."""
    body = BODIES.tracked(Size(STATURE, 0.92), {})[0]
    pose = name_pose(body, {n: v for n, v in POSTURE.items() if n in body.dof_names})
    frame = seen_from(body, [pose] * len(yaws), {f"{yaw:.0f}": around(yaw) for yaw in yaws})
    detected = Size(1.55, 1.05)
    model = BODIES.tracked(detected, {})[0]
    start, size = Start(model, pose, detected), PersonSize(BODIES, DirectRefiner(), measured=True)
    belief = begin(model, pose, SETTINGS.filter)
    found = size.begin(start, belief, subject_of(frame, 3000), SETTINGS.refine, wait=True)
    assert found.size.stature == pytest.approx(STATURE, abs=0.03)
    assert found.size.girth == pytest.approx(girth, rel=0.03)


def test_a_stature_that_is_not_wanted_is_not_measured() -> None:
    """A run without measuring keeps the body that was detected."""
    still, settings = shown("standing").frames[0], msgspec.structs.replace(SETTINGS, measure_person=False)
    tracker = OnePerson(DirectRefiner(), settings, BODIES)
    for n in range(4):
        tracker.track(replace(still, number=n, time_s=0.1 * n))
    assert tracker.state.checkpoint.size is None


class Held(DirectRefiner):
    """Holds the requests of single particles back until they are released."""

    def __init__(self) -> None:
        super().__init__()
        self.released, self.given_up = False, 0

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Pending:
        """As ever, unless there is only one."""
        pending = super().submit(subject, model, particles)
        return HeldRequest(self, pending) if len(particles.poses) == 1 else pending


class HeldRequest:
    """A request for which nobody may wait before it is released."""

    def __init__(self, refiner: Held, pending: Pending) -> None:
        self._refiner, self._pending = refiner, pending

    @property
    def is_ready(self) -> bool:
        """Whether it was released."""
        return self._refiner.released

    def result(self) -> Refined:
        """At once."""
        assert self._refiner.released, "a live frame waits"
        return self._pending.result()

    def cancel(self) -> None:
        """It is given up."""
        self._refiner.given_up += 1


def two_cameras() -> tuple[DepthFrame, TrackerState]:
    """A person of girth 0.92 from the front and from behind; a tracker has measured another stature, 1.55."""
    body = BODIES.tracked(Size(STATURE, 0.92), {})[0]
    pose = name_pose(body, {n: v for n, v in POSTURE.items() if n in body.dof_names})
    frame = seen_from(body, [pose, pose], {"front": around(0.0), "back": around(180.0)})
    state, detected = first_state(BODIES, POSTURE, 0), Size(1.55, 1.05)
    start = replace(state.start, model=BODIES.tracked(detected, {})[0], size=detected)
    return frame, replace(
        state, start=start, checkpoint=replace(state.checkpoint, size=StatureEstimate((STATURE,), time_s=9.0))
    )


def test_a_live_frame_does_not_wait_for_the_girth() -> None:
    """Frames are tracked with the old size until the workers have fitted the girth, and then with the new."""
    frame, state = two_cameras()
    refiner, settings = Held(), msgspec.structs.replace(SETTINGS, recover=False)
    target, sizes = TargetTracker(refiner, settings, BODIES, state), list[Size]()
    for n in range(6):
        now = subject_of(replace(frame, number=n, time_s=n / 30), 3000)
        refiner.released = n == 4
        target.begin_frame()
        submitted = target.submit(now.frame, now, Planes(), Stopwatch(), Pace(1 / 30, is_late=False))
        assert isinstance(submitted, Submitted)
        target.update(submitted)
        sizes.append(target.start.size)
    assert sizes[:4] == [state.start.size] * 4
    assert sizes[4] == sizes[5]
    assert sizes[4].stature == pytest.approx(STATURE, abs=0.01)
    assert sizes[4].girth == pytest.approx(0.92, rel=0.03)
    assert refiner.given_up == 0


def test_a_fit_of_the_girth_that_nobody_takes_is_given_up() -> None:
    """At the end of a stream, the workers do nothing more for it."""
    frame, state = two_cameras()
    refiner, settings = Held(), msgspec.structs.replace(SETTINGS, recover=False)
    target = TargetTracker(refiner, settings, BODIES, state)
    for n in range(2):
        now = subject_of(replace(frame, number=n, time_s=n / 30), 3000)
        submitted = target.submit(now.frame, now, Planes(), Stopwatch(), Pace(1 / 30, is_late=False))
        assert isinstance(submitted, Submitted)
        target.update(submitted)
    target.end()
    assert refiner.given_up == 3
