"""Several people: each keeps the own pixels and identity, and none is detected twice."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from common.settings import Settings
from coordinator.tracking.state import TrackerState
from coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.pairs import pair
from tests.support.people import SETTINGS
from tests.support.people import people as anybody

FEW: Settings = msgspec.structs.replace(SETTINGS, points=1500)


def tracker(people: int, states: Sequence[TrackerState] | None = None) -> Tracker:
    """A tracker of this number of people."""
    return Tracker(DirectRefiner(), FEW, anybody(), people=people, states=states)


def test_two_people_are_detected_and_tracked() -> None:
    """Either within 4 cm of the truth in every frame, the first one the same always; no third is found."""
    first, second = pair()
    last = None
    for number, (*results, third) in enumerate(tracker(3).follow(first.frames)):
        assert not third.state.start.found
        joints = [each.estimate.joint_positions for each in results]
        if joints[0][:, 0].mean() > joints[1][:, 0].mean():
            joints.reverse()
        for found, shown in zip(joints, (first, second), strict=True):
            assert np.linalg.norm(found - shown.joints[number], axis=-1).mean() < 0.04
        order = results[0].estimate.joint_positions[:, 0].mean() < 0.0
        assert last in (None, order)
        last = order
        assert {each.estimate.status for each in results} <= {"tracked", "ambiguous"}
