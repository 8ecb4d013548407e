"""Which candidate is which lost body."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.coordinator.colour.clothes import Clothes
from gepf.coordinator.settings import ColourSettings, TrackSettings
from gepf.coordinator.tracking.reidentification import LostBody, SeenCandidate, assign_lost
from gepf.coordinator.tracking.track_state import Policy

POLICY = Policy(min_points=100, settings=TrackSettings(), colour=ColourSettings())
RED, BLUE, GREEN = np.array([0.6, 0.5, 0.2]), np.array([0.5, -0.1, -0.4]), np.array([0.5, -0.4, 0.1])


def lost(x_m: float, clothes: Array | None = None, unseen_s: float = 10.0, seen_s: float = 20.0) -> LostBody:
    """A body that was last seen here, in these clothes."""
    remembered = None if clothes is None else Clothes(tuple(clothes.tolist()), seen_s)
    return LostBody(np.array([x_m, 0.0, 3.0]), unseen_s, remembered)


def seen(x_m: float, clothes: Array | None = None) -> SeenCandidate:
    """A candidate here, in these clothes."""
    return SeenCandidate(np.array([x_m, 0.0, 3.0]), clothes)


def test_without_colour_places_decide() -> None:
    """All together: the first body leaves its nearest candidate to the second, which has no other."""
    assert assign_lost([lost(0.0)], [seen(2.0), seen(-1.0)], POLICY) == [1]
    assert assign_lost([lost(0.0), lost(1.0)], [seen(0.6), seen(-0.7)], POLICY) == [1, 0]
    assert assign_lost([lost(0.0, unseen_s=1.0), lost(1.0, unseen_s=1.0)], [seen(0.9)], POLICY) == [None, 0]


def test_clothes_decide_where_both_may_be_anywhere() -> None:
    """People who exchanged their places, and one who returns where the other was last seen."""
    both = [lost(-1.0, RED), lost(1.0, BLUE)]
    assert assign_lost(both, [seen(-1.0, BLUE), seen(1.0, RED)], POLICY) == [1, 0]
    assert assign_lost(both, [seen(-1.0, BLUE)], POLICY) == [None, 0]
    assert assign_lost(both, [seen(-1.0), seen(1.0)], POLICY) == [0, 1]  # not looked at in colour


@pytest.mark.parametrize("unseen_s", [0.0, 1.0, 60.0, 1e6])
def test_clothes_also_decide_if_one_was_away_for_longer(unseen_s: float) -> None:
    """The place of a body that left an hour ago is not less certain than a room is wide."""
    both = [lost(0.0, RED, unseen_s=unseen_s), lost(1.0, BLUE, unseen_s=1.0)]
    assert assign_lost(both, [seen(1.0, RED)], POLICY) == [0, None]


def test_a_moment_later_the_place_decides() -> None:
    """A body that has just been lost is not on the other side of the room, whatever the clothes look like."""
    both = [lost(0.0, RED, unseen_s=0.03), lost(5.0, BLUE, unseen_s=0.03)]
    assert assign_lost(both, [seen(0.1, BLUE), seen(5.1, RED)], POLICY) == [0, 1]


def test_a_candidate_in_other_clothes_is_left_to_somebody_new() -> None:
    """If there is room for somebody new. One who refuses a candidate does not keep it from another one."""
    assert assign_lost([lost(0.0, RED)], [seen(0.0, BLUE)], POLICY) == [0]
    assert assign_lost([lost(0.0, RED)], [seen(0.0, BLUE)], POLICY, may_refuse=True) == [None]
    assert assign_lost([lost(0.0, RED)], [seen(0.0, RED)], POLICY, may_refuse=True) == [0]
    assert assign_lost([lost(0.0, RED)], [seen(0.0)], POLICY, may_refuse=True) == [0]
    both = [lost(0.0, RED, unseen_s=0.5), lost(4.0, unseen_s=9.0)]
    assert assign_lost(both, [seen(0.0, BLUE), seen(0.3, GREEN)], POLICY, may_refuse=True)[0] is None
    assert None not in assign_lost(both, [seen(0.0, BLUE), seen(0.3, RED)], POLICY, may_refuse=True)


def test_clothes_that_were_hardly_seen_refuse_nobody() -> None:
    """A single look may have shown something else."""
    briefly = lost(0.0, RED, seen_s=0.1)
    assert assign_lost([briefly], [seen(0.0, BLUE)], POLICY, may_refuse=True) == [0]


def test_nobody_is_lost_or_seen() -> None:
    """Then nobody is assigned."""
    assert assign_lost([], [seen(0.0)], POLICY) == []
    assert assign_lost([lost(0.0), lost(1.0)], [], POLICY) == [None, None]
