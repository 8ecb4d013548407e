"""Several people who hide each other: each of them is one body."""

from __future__ import annotations

from benchmarks.crowd import known_bodies, matched, rendered
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.people import people_of

PEOPLE, EVERY = 6, 3


def test_no_two_bodies_are_on_the_same_person() -> None:
    """Six people, half hidden at first: parts of one person are searched for a second time."""
    crowd = rendered(PEOPLE, 0, 5 * EVERY + 1, False)
    tracker = Tracker(DirectRefiner(), preset("default"), people_of(None), people=PEOPLE)
    shown = crowd.frames[::EVERY]
    for frame, tracked in zip(shown, tracker.follow(shown), strict=True):
        bodies = known_bodies(tracked)
        if frame.number >= 3 * EVERY:  # a body that was just detected is compared in the next frame
            assert len(bodies) >= 4
            assert len(dict(matched(tracked, bodies, crowd.joints[frame.number]))) == len(bodies)
