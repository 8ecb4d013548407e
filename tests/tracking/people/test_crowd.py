"""Several people at once: each keeps what is his, nobody is found twice, and who walks by disturbs nobody."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from common.frame import SUBJECT
from common.settings import Settings
from coordinator.bodies.human.shape_space import person_of_size
from coordinator.bodies.human.template import DEFAULT_ACTIVE
from coordinator.bodies.tracked import Bodies
from coordinator.scene.cutting import cut_out
from coordinator.scene.nearness import surround
from coordinator.scene.scene import Scene
from coordinator.scene.sharing import share
from coordinator.tracking.observing.company import has_company
from coordinator.tracking.people.crowd import Crowd
from coordinator.tracking.people.pipeline import follow_all
from coordinator.tracking.search.verdict import UNEXPLAINED, Verdict
from coordinator.tracking.search.watch import Watch
from gepf.direct import DirectRefiner
from tests.support.pairs import pair
from tests.support.people import SETTINGS, as_bytes
from tests.support.rooms import CABINET, Room

BODIES = Bodies(person_of_size, DEFAULT_ACTIVE, DEFAULT_ACTIVE)
FEW: Settings = msgspec.structs.replace(SETTINGS, points=1500)
STOOD = ((-0.4, 2.6), (0.05, 2.6))


def crowd(people: int) -> Crowd:
    """For so many people."""
    return Crowd(DirectRefiner(), FEW, BODIES, people)


def test_who_touches_another_keeps_the_own_pixels() -> None:
    """Two who stand 5 cm apart: nearly all pixels of each are cut out, and next to none of the other's."""
    room = Room(noise=0.001)
    seen = [room.see(place) for place in STOOD]
    depth = np.minimum(*(each.frame.metres() for each in seen))
    masks = [each.mask & (each.frame.metres() <= depth) for each in seen]
    view = Scene().see(replace(seen[0].frame, depth=np.rint(1000.0 * depth).astype(np.uint16)))
    surfaces = [room.surface((x + 0.04, z)) for x, z in STOOD]  # a step behind
    near = [surround(surface) for surface in surfaces]
    for place, others in enumerate(share(view, surfaces, near)):
        cut = cut_out(view, surfaces[place], near[place], others)
        left, top, right, bottom = cut.window
        mine = np.zeros(depth.shape, dtype=bool)
        mine[top:bottom, left:right] = cut.kinds == SUBJECT
        assert np.sum(mine & masks[place]) / masks[place].sum() > 0.93
        assert np.sum(mine & masks[1 - place]) / mine.sum() < 0.01


def test_who_is_far_from_all_others_is_cut_out_as_if_alone() -> None:
    """Nothing is shared, so nothing is taken away."""
    room = Room()
    view = Scene().see(room.see(STOOD[0]).frame)
    surfaces = [room.surface(place) for place in (STOOD[0], (1.0, 3.0))]
    assert share(view, surfaces, [surround(each) for each in surfaces]) == [None, None]


def test_both_are_found_and_followed() -> None:
    """Either within 4 cm of the truth in every frame, the first one the same all the time."""
    first, second = pair()
    last = None
    for number, results in enumerate(follow_all(crowd(2), first.frames)):
        joints = [estimate.joint_positions for estimate, _ in results]
        if joints[0][:, 0].mean() > joints[1][:, 0].mean():
            joints.reverse()
        for found, shown in zip(joints, (first, second), strict=True):
            assert np.linalg.norm(found - shown.joints[number], axis=-1).mean() < 0.04
        order = results[0][0].joint_positions[:, 0].mean() < 0.0
        assert last in (None, order)
        last = order
        assert {estimate.status for estimate, _ in results} <= {"tracked", "ambiguous"}


def test_a_third_person_whom_nobody_sees_is_absent() -> None:
    """Two are there: nobody is found twice."""
    first, _ = pair()
    following = crowd(3)
    for results in follow_all(following, first.frames[:3]):
        assert results[2][0].status in ("absent", "searching")
    assert [each.start.found for each in following.followers] == [True, True, False]


def test_an_empty_room_has_nobody() -> None:
    """Nobody is found in it, and nothing fails."""
    empty = [replace(frame, depth=np.full_like(frame.depth, 3000)) for frame in pair()[0].frames[:2]]
    for results in follow_all(crowd(2), empty):
        assert [estimate.status for estimate, _ in results] == ["absent", "absent"]


@pytest.mark.parametrize("stop", [1, 3])
def test_people_go_on_bit_for_bit(stop: int) -> None:
    """A crowd from the states of another says what that would have said, and so does `track`."""
    first, _ = pair()
    states, said = [], []
    for results in follow_all(crowd(2), first.frames[:5]):
        said.append([as_bytes(estimate) for estimate, _ in results])
        states.append([state for _, state in results])
    folded = Scene()
    for each in states[:stop]:
        folded.recall(each[0].checkpoint.scene)
    past = [
        replace(state, checkpoint=replace(state.checkpoint, scene=folded.all())) for state in states[stop - 1]
    ]
    going_on = Crowd(DirectRefiner(), FEW, BODIES, 2, states=past)
    for number in range(stop, 5):
        assert [as_bytes(each) for each in going_on.track(first.frames[number])] == said[number]


def test_somebody_else_is_told() -> None:
    """Who stands beside a body is noticed, a cabinet is not; what is unexplained from then on says so."""
    room = Room((CABINET,), noise=0.001)
    seen = [room.see(place).frame.metres() for place in STOOD]
    together = np.rint(1000.0 * np.minimum(*seen)).astype(np.uint16)
    frame = room.see(STOOD[0]).frame
    surface = room.surface(STOOD[0])
    assert not has_company(Scene().see(frame), surface)
    assert has_company(Scene().see(replace(frame, depth=together)), surface)
    bad = Verdict(2.0, UNEXPLAINED)
    assert Watch().followed(bad, anew=False).why == UNEXPLAINED
    told = Watch().accompanied().followed(Verdict(0.5), anew=False).followed(bad, anew=False)
    assert "--people 2" in told.why
