"""What is furniture in some frames is known, and people are not taken for it."""

from __future__ import annotations

import numpy as np

from coordinator.scene.room.furniture import furniture
from tests.support.rooms import CABINET, Room

BESIDE, FAR = (0.75, 2.3), (-0.5, 2.6)  # before the cabinet, and away from it


def test_a_cabinet_is_known_and_nobody_is_taken_for_it() -> None:
    """Who stands still before the cabinet in half of the frames, and elsewhere in others, is none."""
    room = Room((CABINET,), noise=0.001)
    seen = [room.see(BESIDE if number % 2 else FAR, number) for number in range(8)]
    known = furniture(each.frame for each in seen)
    assert known is not None
    empty = room.see(None).frame.metres()
    bare = Room().see(None).frame.metres()
    cabinet = (empty > 0) & (np.abs(empty - bare) > 0.2)
    hidden = np.logical_and.reduce([each.mask for each in seen])
    shown = cabinet & ~hidden
    assert np.mean(known[shown] > 0) > 0.8
    assert np.median(np.abs(known - empty)[shown & (known > 0)]) < 0.01
    people = np.logical_or.reduce([each.mask for each in seen]) & ~cabinet
    assert np.mean(known[people] > 0) < 0.02


def test_people_alone_have_no_furniture() -> None:
    """One who stands still all the time is nothing to know."""
    assert furniture(Room().see(FAR, number).frame for number in range(6)) is None
