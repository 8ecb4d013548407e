"""Keypoints in colour images on the way of a frame: found, used, recorded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS, ROOT_DOFS
from gepf.common.camera import project
from gepf.common.frame import Frame
from gepf.common.kinematics import keypoint_positions
from gepf.common.protocol.frames import decode_frame, encode_frame
from gepf.common.refinement import Particles
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.colour.agreement import ColourState, describe_changes, trusted, with_agreement
from gepf.coordinator.colour.finder import KeypointFinder, PeopleInColour, crop_of
from gepf.coordinator.colour.matching import (
    EXCHANGED,
    ExpectedBody,
    assign,
    in_image,
    keypoint_cost,
    with_keypoints,
    with_sides_of,
)
from gepf.coordinator.colour.motion import trunk_step
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.log import Entry, Opening, append_records, assemble, read_log
from gepf.coordinator.settings import ColourSettings
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.sources.live_stream import LiveCamera
from gepf.coordinator.tracking.colour import (
    ColouredFrame,
    KeypointDetections,
    draw_candidates,
    possible_people,
)
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.reporting import TrackedFrame
from gepf.coordinator.tracking.segmenter import SegmentedFrame, UntrackedPerson
from gepf.coordinator.tracking.track_state import Tracked
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.coloured import coloured
from tests.support.people import (
    CAMERA,
    FRAMES,
    SETTINGS,
    STANDING,
    OnePerson,
    as_bytes,
    changed,
    frame_of,
    known,
    raised,
    rendered,
    shown,
    subject_of,
    tracker,
)

COLOUR = SETTINGS.colour

pytest.importorskip("ai_edge_litert", reason="the extra color is not installed")


def looking(**others: object) -> OnePerson:
    """A tracker of the known person, which looks at colour."""
    start = {} if others else {"start": STANDING}
    return OnePerson(DirectRefiner(), SETTINGS, known(), colour=KeypointFinder(), **start, **others)  # type: ignore[arg-type]


def test_without_colour_the_bytes_are_those_of_depth() -> None:
    """Whether keypoints could be found or not."""
    alone, whole = tracker(), looking()
    for frame in shown("standing").frames:
        assert as_bytes(whole.track(frame)) == as_bytes(alone.track(frame))


def test_keypoints_are_used_recorded_and_the_same_after_a_restart(tmp_path: Path) -> None:
    """They are those of the person, in pixels of the image, and change the estimate.

    From the recorded state after any frame, a new tracker gives the same bytes.
    """
    frames, alone = coloured(), tracker()
    said = [tracked.people[0].estimate for tracked in looking().follow(frames)]
    model, following = human(1.82), looking()
    with (tmp_path / "log").open("ab") as file:
        for number, frame in enumerate(frames):
            estimate = following.track(frame)
            assert as_bytes(estimate) == as_bytes(said[number])
            assert as_bytes(estimate) != as_bytes(alone.track(frame))
            pose = name_pose(model, raised(STANDING, number))[None]
            off = estimate.keypoints[""][:, :2] - project(keypoint_positions(model, pose)[0], CAMERA)
            assert np.median(np.linalg.norm(off, axis=1)) < 6.0  # pixels
            state = following.state
            (person,) = state.people
            entry = Entry(state.frame, [person.start], [person.checkpoint], [estimate], PoolStatistics(), 0.0)
            append_records(file.fileno(), [Opening({}), entry])
            recorded = read_log(Path(file.name))
            assert recorded is not None
            following = looking(state=recorded.state)
    assert recorded is not None
    track = assemble(following.model, recorded.people[0].estimates)
    assert track.keypoint is not None
    assert track.keypoint.shape == (FRAMES, 1, 17, 3)
    assert np.array_equal(track.keypoint[-1, 0], said[-1].keypoints[""])


def test_workers_weigh_what_the_coordinator_says() -> None:
    """The log likelihood changes by the cost of the keypoints, which go over the wire with the frame."""
    frame, whole = coloured()[0], known().tracked(known().usual_size, STANDING)
    subject = isolate(frame, 500)
    assert subject is not None
    (found,) = KeypointFinder().submit(frame, [ExpectedBody(*whole)], COLOUR).result().keypoints
    seen = with_keypoints(subject, found)
    assert seen.largest.image.colours is None  # workers and searches do not keep it
    np.testing.assert_allclose(in_image(seen)[""], found[""], atol=1e-4)
    still = msgspec.structs.replace(SETTINGS.refine, icp_iterations=0)
    poses = whole[1] + 0.1 * np.random.default_rng(0).normal(size=(5, len(whole[1])))
    without, weighed = (
        DirectRefiner().refine(each, whole[0], Particles(poses, still))
        for each in (subject, decode_frame(encode_frame(seen)))
    )
    costs = [
        keypoint_cost(ExpectedBody(whole[0], pose), seen) for pose in weighed.poses
    ]  # within the joints' limits
    assert min(costs) > 0.25
    np.testing.assert_allclose(without.log_likelihood - weighed.log_likelihood, costs, rtol=1e-6)


def test_nobody_is_looked_for_outside_the_image() -> None:
    """A body beside the image or behind the camera has no crop."""
    model, pose = known().tracked(known().usual_size, STANDING)
    assert crop_of(ExpectedBody(model, pose), coloured()[0].views[0]) is not None
    for name, value in (("root_tx", 9.0), ("root_tz", -3.0)):
        away = pose.copy()
        away[model.dof(name)] = value
        assert crop_of(ExpectedBody(model, away), coloured()[0].views[0]) is None


def test_a_person_in_the_image_is_one_body() -> None:
    """Of two bodies around whom the network sees the same person, the nearer one gets the keypoints."""
    model, pose = known().tracked(known().usual_size, STANDING)
    beside = pose.copy()
    beside[model.dof("root_tx")] += 0.3
    bodies, frame = [ExpectedBody(model, each) for each in (pose, beside)], coloured()[0]
    finder = KeypointFinder()
    for body in bodies:
        (alone,) = finder.submit(frame, [body], COLOUR).result().keypoints
        assert alone
    for pair, holder in ((bodies, 0), (bodies[::-1], 1)):
        found = finder.submit(frame, pair, COLOUR).result()
        assert [bool(keypoints) for keypoints in found.keypoints] == [place == holder for place in range(2)]


def test_keypoints_of_another_tracked_person_are_that_persons() -> None:
    """Even if the network sees nobody, or somebody else, around the body of that person."""
    model, pose = known().tracked(known().usual_size, STANDING)
    beside = pose.copy()
    beside[model.dof("root_tx")] += 0.6
    bodies, frame = [ExpectedBody(model, each) for each in (pose, beside)], coloured()[0]
    first, second = (
        {"": np.column_stack([body.pixels(frame.views[0]), np.full(17, 0.1)]).astype(np.float32)}
        for body in bodies
    )
    for seen, given in (
        ([{}, first], [first, {}]),
        ([second, first], [first, second]),
        ([first, second], [first, second]),
        ([{}, second], [{}, second]),
        ([{}, {}], [{}, {}]),
    ):
        found = assign(bodies, seen, frame, COLOUR)
        assert [list(each) for each in found] == [list(each) for each in given]
        for mine, expected in zip(found, given, strict=True):
            for camera in mine:
                assert np.array_equal(mine[camera], expected[camera])


def test_a_second_body_on_the_same_person_is_given_up() -> None:
    """Two bodies begin at one person: the first one stays, with and without colour."""
    for colour in (None, KeypointFinder()):
        two = Tracker(DirectRefiner(), SETTINGS, known(), people=2, start=STANDING, colour=colour)
        for tracked in two.follow(coloured()):
            first, second = (person.estimate.status for person in tracked.people)
            assert first in {"tracked", "ambiguous"}
            assert second not in {"tracked", "ambiguous"}


def with_a_dummy() -> list[Frame]:
    """A person, and beside the person something of the same shape, which colour does not show."""
    still, model = coloured()[0], human(1.82)
    (view,), (dummy,) = still.views, rendered(model, moved_pose())
    depth = np.where(view.depth > 0, view.depth, (1000.0 * dummy).astype(np.uint16))
    return [changed(still, depth=depth, number=n, time_s=0.25 * n) for n in range(10)]


def test_a_body_that_only_depth_shows_ends_where_colour_shows_people() -> None:
    """By depth both are people. With colour the dummy ends within a second or so, and does not come back."""
    dark = [changed(frame, colours=None) for frame in with_a_dummy()]

    def known_bodies(frames: list[Frame], colour: KeypointFinder | None) -> list[int]:
        two = Tracker(DirectRefiner(), SETTINGS, known(), people=2, colour=colour)
        statuses = [[person.estimate.status for person in each.people] for each in two.follow(frames)]
        return [sum(status in {"tracked", "ambiguous"} for status in each) for each in statuses]

    assert known_bodies(with_a_dummy(), None)[-4:] == [2] * 4
    assert known_bodies(dark, KeypointFinder())[-4:] == [2] * 4
    assert known_bodies(with_a_dummy(), KeypointFinder())[-4:] == [1] * 4


def dummies_and_a_person(count: int, step_s: float) -> list[Frame]:
    """Two dummies before a wall, which only depth shows, and from frame 6 on the standing person."""
    (still, *_), (with_person, *_), model = with_a_dummy(), coloured(), human(1.82)
    (view,), is_person = still.views, with_person.views[0].depth > 0
    (other,) = rendered(model, name_pose(model, {**STANDING, "root_tx": -0.9})[None])
    depth = np.where(view.depth > 0, view.depth, (1000.0 * other).astype(np.uint16))
    depth[depth == 0] = 4000
    assert view.colours is not None
    empty = np.where(is_person[..., None], view.colours[~is_person].mean(axis=0), view.colours)
    dummies = changed(
        still, depth=np.where(is_person, np.uint16(4000), depth), colours=empty.astype(np.uint8)
    )
    seen = [dummies] * 6 + [changed(still, depth=depth)] * (count - 6)
    return [changed(frame, number=n, time_s=step_s * n) for n, frame in enumerate(seen)]


def root_places(tracked: TrackedFrame) -> list[Array]:
    """Where the known bodies of a frame are (3,)."""
    names = list(tracked.people[0].state.body.dof_names)
    root = [names.index(name) for name in ROOT_DOFS[:3]]
    statuses = {"tracked", "ambiguous"}
    return [each.estimate.pose[root] for each in tracked.people if each.estimate.status in statuses]


def test_dummies_do_not_keep_the_numbers_of_a_person_who_enters() -> None:
    """Depth takes two dummies for people. They end once colour shows somebody else, who gets a number."""
    two = Tracker(DirectRefiner(), SETTINGS, known(), people=2, colour=KeypointFinder())
    places = [root_places(tracked) for tracked in two.follow(dummies_and_a_person(20, 0.25))]
    assert len(places[5]) == 2
    (last,) = places[-1]
    np.testing.assert_allclose(last, [STANDING[name] for name in ROOT_DOFS[:3]], atol=0.15)


def test_looks_at_candidates_do_not_depend_on_looking_ahead() -> None:
    """Frame by frame, or with the next one segmented ahead: the same bytes, with unconfirmed bodies."""
    frames = dummies_and_a_person(30, 0.05)
    one, other = (
        Tracker(DirectRefiner(), SETTINGS, known(), people=2, colour=KeypointFinder()) for _ in range(2)
    )
    ahead, alone = list(one.follow(frames)), [other.track(frame) for frame in frames]
    assert any(tracked.state.colours[""].agreed_s is not None for tracked in alone if tracked.state.colours)
    for first, second in zip(ahead, alone, strict=True):
        assert first.state.colours == second.state.colours
        for person, same in zip(first.people, second.people, strict=True):
            assert person.estimate.pose.tobytes() == same.estimate.pose.tobytes()


def test_a_given_start_is_not_doubted_by_colour() -> None:
    """Whoever gives a start says that a person is there, whatever colour shows elsewhere."""
    at_dummy = {**STANDING, "root_tx": 1.1}
    frames = [changed(frame, number=n) for n, frame in enumerate(dummies_and_a_person(20, 0.25)[6:])]
    one = Tracker(DirectRefiner(), SETTINGS, known(), start=at_dummy, colour=KeypointFinder())
    for tracked in one.follow(frames):
        (place,) = root_places(tracked)
        np.testing.assert_allclose(place[0], at_dummy["root_tx"], atol=0.1)
    assert tracked.state.colours[""].agreed_s is None  # nobody has to be found


def test_a_candidate_of_a_rig_keeps_the_keypoints_of_the_cameras_that_are_used() -> None:
    """Colour of one camera is not used; that of the other one shows a candidate, who may be searched."""
    (image,) = coloured()[0].views
    subject = isolate(coloured()[0], 400)
    assert subject is not None
    segmented = SegmentedFrame(coloured()[0], (None,), (None,), (False,), (UntrackedPerson(subject),), ())
    seen = {image.camera: np.ones((len(KEYPOINTS), 3), np.float32)}
    detections = KeypointDetections(
        PeopleInColour([{}], [()]), {0: {**seen, "other": seen[image.camera]}}, [None]
    )
    states = with_agreement({"other": ColourState(used=False)}, {image.camera}, 0.0)
    (free,) = ColouredFrame(segmented, detections, states, [None], COLOUR).free
    assert free.is_confirmed


def test_colour_that_shows_nobody_denies_nobody() -> None:
    """In the dark, depth alone decides, from the first frame on or after the light has gone out."""
    lit = with_a_dummy()
    colours = lit[0].views[0].colours
    assert colours is not None
    dark = np.zeros_like(colours)
    frames = [changed(lit[0], number=n, time_s=0.5 * n, colours=dark) for n in range(4)]
    two = Tracker(DirectRefiner(), SETTINGS, known(), people=2, colour=KeypointFinder())
    for tracked in two.follow(frames):
        assert {person.estimate.status for person in tracked.people} <= {"tracked", "ambiguous", "searching"}
    assert {person.estimate.status for person in tracked.people} <= {"tracked", "ambiguous"}
    agreed = ColourState().after(["agrees"], 0.5, 10.0, COLOUR)
    assert trusted({"": agreed}, 10.5, COLOUR) == {""}
    assert not trusted({"": agreed}, 60.0, COLOUR)
    assert not trusted({"": ColourState().after(["elsewhere"], 0.5, 10.0, COLOUR)}, 10.0, COLOUR)


def test_a_person_is_segmented_where_colour_shows_the_person() -> None:
    """At a low rate a person moves out of reach of depth alone. The way is that of the trunk's keypoints."""
    frame, (model, pose) = coloured()[0], known().tracked(known().usual_size, STANDING)
    for step in ([0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [-0.3, 0.0, 0.3], [0.1, 0.1, -0.4]):
        before = pose.copy()
        before[[model.dof(name) for name in ROOT_DOFS[:3]]] -= step
        body = ExpectedBody(model, before)
        (keypoints,) = KeypointFinder().submit(frame, [body], COLOUR).result().keypoints
        moved = trunk_step(body, keypoints, frame, 0.8, COLOUR)
        assert moved is not None
        np.testing.assert_allclose(moved, step, atol=0.06)
        assert trunk_step(body, {}, frame, 0.8, COLOUR) is None
        assert np.linalg.norm(step) < 0.3 or trunk_step(body, keypoints, frame, 0.2, COLOUR) is None


def test_candidates_whom_colour_shows_come_first() -> None:
    """They get their keypoints, if these are on their pixels; the others stay unless colour is trusted."""
    person, beside = (
        subject_of(changed(frame, colours=None), 500)
        for frame in (coloured()[0], frame_of(0, rendered(human(1.82), moved_pose())[0]))
    )
    finder, up = KeypointFinder(), {"": np.array([0.0, -1.0, 0.0])}
    candidates = [(beside, beside), (person, person)]
    found = finder.look_at(dict(enumerate(candidates)), coloured()[0], up, COLOUR)
    assert {place: bool(keypoints) for place, keypoints in found.items()} == {0: False, 1: True}
    model, pose = known().tracked(known().usual_size, STANDING)
    places = ExpectedBody(model, pose).pixels(coloured()[0].views[0])
    assert np.median(np.linalg.norm(found[1][""][:, :2] - places, axis=1)) < 6.0  # pixels
    people = [UntrackedPerson(beside), UntrackedPerson(person).with_keypoints(found[1])]
    assert possible_people(people, {}) == people[::-1]
    assert people[1].subject.largest.keypoints is not None
    assert possible_people(people, {""}) == people[1:]
    assert possible_people(people[:1], {""}) == []  # until their turn


@pytest.mark.parametrize("step", [1, 2, 3, 6])
def test_every_candidate_has_its_turn(step: int) -> None:
    """Whichever frames are looked at: live, some are left out. The turn follows from the frame's number."""
    for count, most in ((2, 1), (6, 1), (6, 2), (3, 5)):
        turns = [draw_candidates(number, count, most) for number in range(0, 40 * step, step)]
        assert {place for turn in turns for place in turn} == set(range(count))
        assert {len(set(turn)) for turn in turns} == {min(count, most)}
        assert turns[-1] == draw_candidates(39 * step, count, most)


def moved_pose() -> Array:
    """The standing person, 1.1 m to the side (1, D)."""
    return name_pose(human(1.82), {**STANDING, "root_tx": 1.1})[None]


def test_colour_that_is_elsewhere_is_not_used_until_it_agrees() -> None:
    """Four seconds of images shifted by 10 cm end the use, four seconds of right ones begin it again.

    With `follow`, with `track`, and from any recorded state, the same frames have keypoints.
    """
    still, used, resumed = coloured()[0], list[bool](), list[bool]()
    right = still.views[0].colours
    assert right is not None
    shifted = np.roll(right, 11, axis=1)
    frames = [
        changed(still, number=n, time_s=0.5 * n, colours=shifted if n < 12 else right) for n in range(24)
    ]
    following = looking()
    for tracked in following.follow(frames):
        used.append(bool(tracked.people[0].estimate.keypoints))
    restarted = looking()
    for frame in frames:
        resumed.append(bool(restarted.track(frame).keypoints))
        restarted = looking(state=restarted.state)
    assert resumed == used
    ended, begun = used.index(False), used.index(True, used.index(False))
    assert 4.0 <= frames[ended].time_s <= 6.0
    assert 4.0 <= frames[begun].time_s - 0.5 * 12 <= 5.0
    assert used == [n < ended or n >= begun for n in range(24)]
    assert [line[:22] for line in describe_changes({}, {"a": ColourState(2.0, used=False)})] == [
        "colour of camera a sho"
    ]


def test_a_body_is_searched_for_again_after_seconds_of_exchanged_sides() -> None:
    """They are disagreement of left and right, and not of colour, which is used all the time."""
    still = coloured()[0]
    mirrored = DisturbedFinder(lambda seen: seen[EXCHANGED])
    follow = OnePerson(DirectRefiner(), SETTINGS, known(), colour=mirrored, start=STANDING).follow
    frames = [changed(still, number=n, time_s=0.5 * n) for n in range(14)]
    used, sides = list[bool](), list[float]()
    for tracked in follow(frames):
        (person,) = tracked.people
        used.append(bool(person.estimate.keypoints))
        track = person.state.track
        assert isinstance(track, Tracked)
        sides.append(track.sides_s)
    assert all(used)
    assert min(sides) <= -4.0


class DisturbedFinder(KeypointFinder):
    """Finds keypoints, and changes them."""

    def __init__(self, disturb: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> None:
        super().__init__()
        self._disturb = disturb

    def _look(
        self, frame: Frame, body: ExpectedBody | None, settings: ColourSettings
    ) -> dict[str, NDArray[np.float32] | None]:
        looked = super()._look(frame, body, settings)
        return {camera: None if seen is None else self._disturb(seen) for camera, seen in looked.items()}


class Hurried(LiveFrames):
    """Live frames of which the next one always waits."""

    def __init__(self) -> None:
        super().__init__([LiveCamera("camera")], print)

    @property
    def is_ready(self) -> bool:
        """Always."""
        return True


def test_left_and_right_are_those_of_a_body_whose_facing_is_known() -> None:
    """Keypoints with both exchanged are taken as if they were not; of another pose they stay as they are."""
    model, pose = known().tracked(known().usual_size, STANDING)
    body, frame = ExpectedBody(model, pose), coloured()[0]
    subject = isolate(frame, 500)
    assert subject is not None
    right = np.column_stack([body.pixels(frame.views[0]), np.full(17, 0.1)]).astype(np.float32)
    for seen, taken in ((right, right), (right[EXCHANGED], right), (right + 40.0, right + 40.0)):
        before = with_keypoints(subject, {"": seen})
        sided = with_sides_of(before, body, COLOUR)
        assert (sided is before) == (seen is taken or np.array_equal(seen, taken))
        np.testing.assert_allclose(in_image(sided)[""][:, :2], taken[:, :2], atol=1e-3)
    names = [KEYPOINTS[place] for place in EXCHANGED]
    assert names[:3] == ["nose", "right_eye", "left_eye"]
    assert [KEYPOINTS.index(name) for name in names] == EXCHANGED


def test_under_load_colour_is_looked_at_twice_a_second() -> None:
    """While frames are late; those without are counted. Recorded frames never are."""
    finder = KeypointFinder()
    hurried = OnePerson(DirectRefiner(), SETTINGS, known(), colour=finder, start=STANDING)
    frames = [
        changed(frame, time_s=time_s) for frame, time_s in zip(coloured(), (0.0, 0.1, 0.5, 0.6), strict=True)
    ]
    said = [bool(tracked.people[0].estimate.keypoints) for tracked in hurried.follow(frames, live=Hurried())]
    assert said == [True, False, True, False]
    assert finder.left_out == 2
