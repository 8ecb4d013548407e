"""The tracker on short rendered sequences, in one process: start, tracking, certainty."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.results.log import pack_array
from gepf.coordinator.scene.noise import NO_NOISE
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import CertaintySettings, Settings
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.sources.live_stream import LiveCamera
from gepf.coordinator.tracking.detector import Detector
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN, Estimate
from gepf.coordinator.tracking.judgement import has_rival
from gepf.coordinator.tracking.particle_filter import FrameBudget, SubmittedPerson
from gepf.coordinator.tracking.refiner import Request
from gepf.coordinator.tracking.reporting import Stopwatch, report
from gepf.coordinator.tracking.segmenter import BodyView, UntrackedPerson
from gepf.coordinator.tracking.state import PersonState, first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import Body
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from gepf.worker.kernel.icp import refine
from tests.support.people import (
    FRAMES,
    RAISING,
    SETTINGS,
    STANDING,
    OnePerson,
    as_bytes,
    changed,
    empty,
    frame_of,
    known,
    people,
    raised,
    show,
    shown,
    subject_of,
    tracker,
)
from tests.support.rooms import in_a_room
from tests.support.stand_ins import Direct, StillWorkers

FOLLOWING = msgspec.structs.replace(SETTINGS, recover=False)  # looks nowhere else


def belief_of(state: PersonState) -> Belief:
    """The belief in a body that is known."""
    assert isinstance(state.track, Body)
    return state.track.belief


def apart(estimate: Estimate, joints: Array) -> Array:
    """Distance (J,) of every joint from the truth, metres."""
    return np.asarray(np.linalg.norm(estimate.joint_positions - joints, axis=-1))


@pytest.mark.parametrize(
    ("posture", "stature", "room"),
    [("standing", 1.82, True), ("standing", 1.6, False), ("sitting", 1.85, False)],
)
def test_it_starts_by_itself_and_follows(posture: str, stature: float, room: bool) -> None:
    """Without a start, it finds stature, pelvis and all joints in every frame; alone or in a room."""
    frames, joints = shown(posture, stature)
    fresh = OnePerson(DirectRefiner(), SETTINGS, people())
    for frame, truth in zip(frames, joints, strict=True):
        estimate = fresh.track(in_a_room(frame) if room else frame)
        assert estimate.status == "tracked"
        assert apart(estimate, truth)[fresh.model.joint_names.index("pelvis")] < 0.05
        assert np.median(apart(estimate, truth)) < 0.03
        assert apart(estimate, truth).max() < 0.08
    assert Size(*fresh.start.size).stature == pytest.approx(stature, rel=0.05)


def test_legs_behind_a_table_are_not_drawn_out_of_it() -> None:
    """An object before the legs is no evidence against them; the same pixels as empty ones are."""
    frames, joints = shown("standing", 1.82)
    legs = [n for n, name in enumerate(known().full(1.82, 1.0).joint_names) if "ankle" in name]
    rows = slice(160, 240)

    def error(nearer: bool) -> float:
        following = tracker()
        for frame in frames:
            scene = in_a_room(frame)
            depth = scene.views[0].depth.copy()
            depth[rows] = 1500 if nearer else 3300
            estimate = following.track(changed(scene, depth=depth))
        return float(apart(estimate, joints[-1])[legs].max())

    assert error(nearer=True) < 0.5 * error(nearer=False)


def test_the_way_from_the_initial_guess_is_no_motion() -> None:
    """However far the first frame moves a wrong start, velocity is learnt from the second on."""
    frames, _ = shown("standing")
    followed = tracker(start={**STANDING, "r_shoulder_flexion": 0.4})
    first = followed.track(frames[0])
    assert abs(first.pose - followed.start.pose).max() > 0.2
    assert not belief_of(followed.person).velocities.any()
    followed.track(frames[1])
    assert belief_of(followed.person).velocities.any()


def test_an_estimate_is_whole() -> None:
    """Weights sum to 1, likeliest first, the first hypothesis is the pose, and the joints are those of it."""
    frames, _ = shown("standing")
    followed = tracker()
    for frame in frames[:2]:
        estimate = followed.track(frame)
    assert followed.start.size == Size(1.82, 1.0)
    np.testing.assert_array_equal(followed.start.pose, name_pose(followed.model, STANDING))
    assert (estimate.frame, estimate.time_s) == (1, frames[1].time_s)
    assert estimate.hypothesis_weight.sum() == pytest.approx(1.0)
    assert np.all(np.diff(estimate.hypothesis_weight) <= 0.0)
    np.testing.assert_array_equal(estimate.pose, estimate.hypothesis_pose[0])
    joints = joint_positions(followed.model, estimate.pose[None])[0]
    np.testing.assert_array_equal(estimate.joint_positions, joints)
    assert 0.0 < estimate.residual < 0.03
    assert {"segment", "publish", "draw", "refine", "merge"} <= estimate.stage_seconds.keys()


@dataclass(frozen=True, slots=True, eq=False)
class WatchedRequest:
    """A request whose result is marked."""

    pending: Request
    events: list[str]

    def poll(self) -> bool:
        """Always answered."""
        return True

    def result(self) -> Refined:
        """As ever; the workers are idle then."""
        refined = self.pending.result()
        self.events.append("idle")
        return refined

    def cancel(self) -> None:
        """It is given up."""
        self.events.append("given up")


class Watched(Direct):
    """Keeps the order of what is done with the workers, and may fail at a frame, after some requests."""

    def __init__(self, fails_at: int | None = None, fails_after: int = 0) -> None:
        super().__init__()
        self.events: list[str] = []
        self._fails_at, self._answered = fails_at, fails_after

    def publish(self, subject: SubjectFrame) -> None:
        """The workers get a frame."""
        self.events.append(f"sent {subject.number}")

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> WatchedRequest:
        """The workers get busy."""
        if subject.number == self._fails_at:
            if self._answered == 0:
                raise RuntimeError("the workers are gone")
            self._answered -= 1
        self.events.append("busy")
        return WatchedRequest(super().submit(subject, model, particles), self.events)


def test_a_frame_is_told_while_the_workers_are_busy_with_the_next() -> None:
    """The last comes at the end; each with the state that was known after it, and nothing else changes."""
    frames, refiner = list(shown("standing").frames), Watched()
    frames[2] = empty(2)  # nothing to be busy with: the frame before comes all the same; frame 3 merges early
    states: list[PersonState] = []
    for tracked in OnePerson(refiner, FOLLOWING, known(), start=STANDING).follow(frames):
        (person,) = tracked.people
        refiner.events.append(f"told {person.estimate.frame}")
        states.append(person.state)
    assert refiner.events == [
        *("sent 0", "busy", "sent 1", "idle"),
        *("sent 1", "busy", "told 0", "idle"),
        *("told 1", "sent 3", "sent 3", "busy", "told 2", "idle", "busy", "idle", "told 3"),
    ]
    one_by_one = tracker(FOLLOWING)
    for frame, state in zip(frames, states, strict=True):
        one_by_one.track(frame)
        assert msgspec.msgpack.encode(state.checkpoint, enc_hook=pack_array) == msgspec.msgpack.encode(
            one_by_one.person.checkpoint, enc_hook=pack_array
        )


def test_at_low_rates_a_frame_is_segmented_around_the_pose_of_the_frame_before() -> None:
    """Below 17 frames a second, also with look-ahead; above, around that of two frames before."""
    frames = shown("standing").frames
    for interval_s in (0.25, 1 / 15, 1 / 19, 1 / 30):
        timed = [changed(frame, time_s=interval_s * n) for n, frame in enumerate(frames)]
        ahead, alone = tracker(FOLLOWING), tracker(FOLLOWING)
        estimates = [tracked.people[0].estimate for tracked in ahead.follow(timed)]
        assert [as_bytes(each) for each in estimates] == [as_bytes(alone.track(frame)) for frame in timed]
        for track in (ahead.person.track, alone.person.track):
            assert isinstance(track, Body)
            assert track.next_segmentation.pose is not None
            is_newest = np.array_equal(track.next_segmentation.pose, track.belief.reported)
            assert is_newest == (interval_s > 1 / 17)


class Waiting(LiveFrames):
    """Live frames of which the next one always waits."""

    is_ready, period_s = True, 1 / 30


class Idle(Waiting):
    """Live frames of which none waits, so that searches end first."""

    is_ready = False


def test_a_live_frame_is_told_before_the_workers_get_busy_with_the_next() -> None:
    """Also if that one waits already."""
    refiner = Watched()
    follow = OnePerson(refiner, FOLLOWING, known(), start=STANDING).follow
    for tracked in follow(shown("standing").frames[:3], live=Waiting([LiveCamera("depth")], print)):
        refiner.events.append(f"told {tracked.people[0].estimate.frame}")
    order = [event for event in refiner.events if event[:4] in {"busy", "told"}]
    assert order == ["busy", "told 0", "busy", "told 1", "busy", "told 2"]


def test_a_live_frame_does_not_wait_for_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The body that was searched for in the first frame is tracked in the others, where it is by then.

    A later search checks it. Without workers, a frame waits for one of its requests at most.
    """
    requests, posture = list[int](), shown("standing")

    def count(*given: Any, **options: Any) -> Refined:
        requests.append(0)
        return refine(*given, **options)

    monkeypatch.setattr("gepf.refiners.refine", count)
    places = [min(n, FRAMES - 1) for n in range(8)]
    frames = [changed(posture.frames[k], number=n, time_s=n / 30) for n, k in enumerate(places)]
    follow = Tracker(DirectRefiner(), SETTINGS, people()).follow
    live = follow(frames, live=Waiting([LiveCamera("depth")], print))
    (first, _), *others = [(tracked.people[0].estimate, len(requests)) for tracked in live]
    assert first.status == "searching"
    for (each, _), place in zip(others, places[1:], strict=True):
        assert each.status == "tracked"
        assert apart(each, posture.joints[place]).mean() < 0.04
    assert max(np.diff([done for _, done in others])) == 2


@pytest.mark.parametrize("rates", [RAISING, {"root_tx": 0.2}])
def test_a_person_who_moves_during_a_live_search_is_tracked_soon_after(rates: dict[str, float]) -> None:
    """When the search ends, the arm or the whole person is elsewhere; both are found a few frames later."""
    numbers = (0, 4, 5, 6, 7, 8)
    poses = [name_pose(human(1.82), raised(STANDING, min(n, 4), rates)) for n in numbers]
    images, joints = show(human(1.82), np.array(poses))
    frames = [changed(f, number=n, time_s=n / 30) for f, n in zip(images, numbers, strict=True)]
    target = TargetTracker(DirectRefiner(), SETTINGS, known(), first_state(known(), None, SETTINGS))
    budget, estimates = FrameBudget(1 / 30, is_late=True), list[Estimate]()
    for frame in frames:
        target.accept_first_detection()
        submitted = target.submit(BodyView(frame, subject_of(frame, 2000), Planes()), Stopwatch(), budget)
        if target.search is not None:
            target.search.finish()
        if isinstance(submitted, SubmittedPerson):
            estimates.append(report(target.update(submitted, {}), {}, SETTINGS).estimate)
    off = [apart(each, joints[-1]).max() for each in estimates]
    assert off[-1] < 0.05
    assert max(o for o, each in zip(off, estimates, strict=True) if each.status == "tracked") < 0.2


def test_a_person_who_walks_during_a_live_search_is_tracked_whole() -> None:
    """In a room, so far that the detected pose is no longer near most of the person."""
    poses = [name_pose(human(1.82), {**STANDING, "root_tx": x}) for x in (0.0, 0.6, 0.6)]
    images, joints = show(human(1.82), np.array(poses))
    frames = [changed(in_a_room(f), number=n, time_s=n / 30) for f, n in zip(images, (0, 6, 7), strict=True)]
    follow = Tracker(DirectRefiner(), SETTINGS, people()).follow
    _, first, _ = follow(frames, live=Idle([LiveCamera("depth")], print))
    assert apart(first.people[0].estimate, joints[1]).mean() < 0.05


def test_a_live_search_that_fails_counts_as_in_a_recording() -> None:
    """What is no person is searched as often, also if a frame shows nobody else while a search runs."""
    image = np.pad(np.full((40, 40), 2.5), ((100, 100), (150, 130)))
    recorded, live = (
        TargetTracker(StillWorkers(), SETTINGS, people(), first_state(people(), None, SETTINGS))
        for _ in range(2)
    )
    budget = FrameBudget(1 / 30, is_late=True)
    for number in range(0, 12, 4):
        for n in range(number, number + 4):
            frame = frame_of(n, image)
            view = BodyView(frame, subject_of(frame, 2000), Planes())
            recorded.submit(view, Stopwatch())
            if n == number:
                live.submit(view, Stopwatch(), budget)
            elif n == number + 1:
                live.submit(replace(view, subject=None), Stopwatch(), budget)
                assert live.search is not None
                live.search.finish()
            elif n == number + 3:
                live.submit(view, Stopwatch(), budget)  # it takes the result
        assert live.track == recorded.track


def test_a_search_that_ends_early_leaves_nothing_behind() -> None:
    """Its requests are cancelled; after an error, the next frame begins another one."""
    frame, refiner = shown("standing").frames[0], Watched()
    search = Detector(people(), refiner, SETTINGS).detect(
        UntrackedPerson(subject_of(frame, 2000)), NO_NOISE, Planes()
    )
    next(search)
    search.close()
    assert refiner.events.count("given up") == refiner.events.count("busy") > 0
    fresh = OnePerson(Watched(fails_at=0), SETTINGS, people())
    for _ in range(2):
        with pytest.raises(RuntimeError, match="the workers are gone"):
            fresh.track(frame)


def test_a_frame_fails_if_the_workers_are_gone_when_its_representatives_are_sent() -> None:
    """At 10 frames per second, particles are merged early. The frame before is still reported."""
    frames = [changed(frame, time_s=n / 10) for n, frame in enumerate(shown("standing").frames[:3])]
    refiner = Watched(fails_at=1, fails_after=1)
    following, reports = OnePerson(refiner, FOLLOWING, known(), start=STANDING), list[int]()
    with pytest.raises(RuntimeError, match="the workers are gone"):
        reports.extend(tracked.people[0].estimate.frame for tracked in following.follow(frames))
    assert reports == [0]
    assert refiner.events[-2:] == ["busy", "idle"]


def test_nothing_is_loaded_while_a_frame_waits_for_it() -> None:
    """After preparation, no compiled function and no pose library is new to a frame in a room."""
    script = """
import gc
from numba.core.dispatcher import Dispatcher
from gepf.coordinator.tracking.pose_library import library_of
from gepf.coordinator.tracking.warm_up import IdentityRefiner
from gepf.coordinator.tracking.tracker import Tracker
from tests.support.people import SETTINGS, STANDING, people, shown
from tests.support.rooms import in_a_room
bodies = people()
Tracker(IdentityRefiner(), SETTINGS, bodies).prepare()
built = library_of.cache_info().misses
new = [each for each in gc.get_objects() if isinstance(each, Dispatcher) and not each.signatures]
frames = [in_a_room(frame) for frame in shown("standing").frames]
for start in (None, STANDING):
    list(Tracker(IdentityRefiner(), SETTINGS, bodies, start=start).follow(frames))
print([each.__name__ for each in new if each.signatures], library_of.cache_info().misses - built)
"""
    assert subprocess.check_output([sys.executable, "-c", script], text=True) == "[] 0\n"


def test_an_empty_frame_shows_nobody_and_it_goes_on() -> None:
    """Where nothing is seen the pose stays, without a residual; with the next picture tracking resumes."""
    frames, joints = shown("standing")
    followed = tracker()
    before = followed.track(frames[0])
    blind = followed.track(empty(1))
    after = followed.track(frames[2])
    assert [e.status for e in (before, blind, after)] == ["tracked", "absent", "tracked"]
    np.testing.assert_array_equal(blind.pose, before.pose)
    assert np.isnan(blind.residual)
    assert blind.frame == 1
    assert np.median(apart(after, joints[2])) < 0.02
    assert apart(after, joints[2]).max() < 0.2  # the wrist went on rising meanwhile, by 0.3
    assert apart(followed.track(frames[3]), joints[3]).max() < 0.08


@pytest.mark.parametrize("settings", [FOLLOWING, SETTINGS])
def test_what_is_far_from_the_body_and_no_person_is_not_tracked(settings: Settings) -> None:
    """A person's depth moved away by 3.5 m is too large for one: never tracked, and soon given up."""
    frames, _ = shown("standing")
    followed = tracker(settings)
    followed.track(frames[0])
    (view,) = frames[1].views
    depth_m = np.where(view.depth > 0, view.metres() + 3.5, 0.0)
    status = [followed.track(frame_of(n, depth_m)).status for n in range(1, 6)]
    assert "tracked" not in status
    assert status[-1] in POSE_UNKNOWN


def test_nobody_is_there_until_somebody_comes() -> None:
    """Frames before are absent, without a pose; then the body is found, in whichever frame that is."""
    frames, joints = shown("standing")
    fresh = OnePerson(DirectRefiner(), SETTINGS, people())
    before = [fresh.track(empty(n)) for n in range(3)]
    assert [e.status for e in before] == ["absent"] * 3
    assert not fresh.start.found
    assert all(np.isnan(e.pose).all() and len(e.hypothesis_weight) == 0 for e in before)
    after = fresh.track(frames[0])
    assert after.status == "tracked"
    assert fresh.start.found
    assert apart(after, joints[0]).max() < 0.08


@pytest.mark.parametrize(
    ("weights", "away", "reported", "rival"),
    [
        ([1.0], [0.0], 0, False),
        ([0.9, 0.1], [0.0, 0.3], 0, False),  # elsewhere, but unlikely
        ([0.9, 0.1], [0.0, 0.3], 1, True),  # the reported pose is not the most likely one
        ([0.5, 0.1, 0.4], [0.0, 0.3, 0.3], 0, True),
    ],
)
def test_a_rival_is_about_as_likely_and_has_a_joint_elsewhere(
    weights: list[float], away: list[float], reported: int, *, rival: bool
) -> None:
    """Only then the pose is ambiguous."""
    joints = np.zeros((len(weights), 2, 3))
    joints[:, 1, 0] = away
    assert has_rival(np.array(weights), joints, joints[reported], CertaintySettings()) == rival


def test_points_are_picked_evenly() -> None:
    """As many as asked for, in ascending order, each from its own equal share of the pixels."""
    frame = shown("standing").frames[0]
    every, some = (subject_of(frame, points).largest for points in (10**6, 500))
    assert len(some.picked) == 500 < len(every.picked)
    steps = np.diff(np.searchsorted(every.picked, some.picked))
    assert steps.max() - steps.min() <= 1
