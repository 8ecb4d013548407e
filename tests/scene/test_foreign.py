"""Other people and things that touch a tracked body are not the body."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.arrays import Mask
from gepf.common.frame import SUBJECT, Frame
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.segmenter import ExpectedSurface, SegmentedFrame, Segmenter
from tests.support.rooms import PERSON, Room

STEP_M = 0.04  # a frame; until the box touches the legs and the trunk
FRAMES = 12


def room_of(number: int) -> Room:
    """A room in which something as large as a child comes nearer from the right."""
    left = PERSON[0] + 0.12 + STEP_M * max(0, FRAMES - 1 - number)
    return Room((((left, 0.05, PERSON[1] - 0.05), (left + 0.35, 1.1, PERSON[1] + 0.2)),), noise=0.001)


def thing_in(number: int) -> Mask:
    """The pixels (H, W) of the thing, where the person does not hide it."""
    image, person = room_of(number).see(PERSON, number)
    return np.asarray((image.metres() < Room().see(None).view.metres() - 0.1) & ~person)


def share_taken(segmented: SegmentedFrame, number: int) -> float:
    """The share of the thing's pixels that are labelled as the body's."""
    body = segmented.views[0].bodies[0]
    assert body is not None
    assert body.labels is not None
    left, top, right, bottom = body.window
    inside = np.zeros(thing_in(number).shape, np.bool_)
    inside[top:bottom, left:right] = body.labels == SUBJECT
    return float(inside[thing_in(number)].mean())


def follow(segmenter: Segmenter, first: int, *, new: bool = False) -> SegmentedFrame:
    """Segment the frames from one on around the person, whose pose is known."""
    surface = Room().surface(PERSON)
    for number in range(first, FRAMES):
        frame = Frame.of(room_of(number).see(PERSON, number).view)
        segmented = segmenter.segment(frame, [ExpectedSurface(surface, is_new=new)])
        segmenter.learn(segmented)
    return segmented


def test_what_comes_to_touch_a_body_stays_foreign() -> None:
    """Somebody who was seen to come is told from the body; without the past, a large part is the body's."""
    last = FRAMES - 1
    without_past = share_taken(follow(Segmenter(300, SceneSettings()), last), last)
    with_past = share_taken(follow(Segmenter(300, SceneSettings()), 0), last)
    assert without_past > 0.35
    assert with_past < 0.5 * without_past


def test_a_new_body_may_own_what_is_around_it() -> None:
    """Its limbs may be where the detection did not expect them, in what was foreign before."""
    last = FRAMES - 1
    assert share_taken(follow(Segmenter(300, SceneSettings()), 0, new=True), last) > 0.35


@pytest.mark.parametrize("first", [4, FRAMES - 1])
def test_changes_alone_restore_what_is_foreign(first: int) -> None:
    """A resumed run labels the same pixels."""
    surface = Room().surface(PERSON)
    segmenter, resumed = Segmenter(300, SceneSettings()), Segmenter(300, SceneSettings())
    for number in range(FRAMES):
        frame = Frame.of(room_of(number).see(PERSON, number).view)
        segmented = segmenter.segment(frame, [ExpectedSurface(surface)])
        if number < first:
            resumed.restore(segmenter.learn(segmented))
            continue
        segmented_again = resumed.segment(frame, [ExpectedSurface(surface)])
        segmenter.learn(segmented)
        resumed.learn(segmented_again)
        mine, again = segmented.subjects[0], segmented_again.subjects[0]
        assert mine is not None
        assert again is not None
        np.testing.assert_array_equal(mine.largest.labels, again.largest.labels)
        np.testing.assert_array_equal(mine.largest.picked, again.largest.picked)
