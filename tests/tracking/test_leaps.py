"""A camera of few frames a second: a person who has moved far is found in the same frame."""

from __future__ import annotations

from pathlib import Path

import pytest

from coordinator.bodies.human.template import DEFAULT_ACTIVE, person_of_size
from coordinator.bodies.tracked import Bodies
from coordinator.sources import open_source
from gepf.direct import DirectRefiner
from tests.support.people import SETTINGS, OnePerson

WALKER = Path(__file__).parents[3] / "shared" / "data" / "real_rooms" / "ist_um"
FARTHER = {9: 3.0, 10: 3.3}  # metres, by frame: the walker was nearer two frames before


@pytest.mark.slow
@pytest.mark.skipif(not WALKER.is_dir(), reason="the class room is not beside the checkout")
def test_who_is_farther_by_half_a_metre_is_not_lost() -> None:
    """At four frames a second nothing of the walker is where it was; it is found where it is."""
    tracker = OnePerson(DirectRefiner(), SETTINGS, Bodies(person_of_size, DEFAULT_ACTIVE, DEFAULT_ACTIVE))
    source = open_source(WALKER)
    estimates = {number: tracker.track(source.frame(number)) for number in range(max(FARTHER) + 1)}
    pelvis = tracker.model.joint_names.index("pelvis")
    for number, away in FARTHER.items():
        assert estimates[number].status in ("tracked", "ambiguous")
        assert estimates[number].joint_positions[pelvis, 2] > away
