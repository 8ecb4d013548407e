"""Bodies without evidence of their own: which of two bodies on one person stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.coordinator.scene.explained import count_explained, explained_away
from gepf.coordinator.scene.scene import Scene
from gepf.coordinator.scene.segmentation import measure_distances
from gepf.coordinator.settings import SceneSettings
from tests.support.rooms import Room

MIN_SHARE = 0.2
LEFT, RIGHT = (-0.25, 2.4), (0.25, 2.6)


def counted(people: list[tuple[float, float]], bodies: list[tuple[float, float] | None]) -> Array:
    """The counts of bodies in a room with people."""
    room = Room(noise=0.001)
    seen = [room.see(place).view for place in people]
    view = Scene(SceneSettings()).see(replace(seen[0], depth=np.minimum.reduce([one.depth for one in seen])))
    surfaces = [None if place is None else room.surface(place) for place in bodies]
    distances = [None if surface is None else measure_distances(view, surface) for surface in surfaces]
    return count_explained(view, surfaces, distances)


@pytest.mark.parametrize(
    ("people", "bodies", "known_s", "away"),
    [
        ([LEFT, RIGHT], [LEFT, RIGHT], [1.0, 2.0], [False, False]),
        ([LEFT], [LEFT, LEFT], [1.0, 2.0], [True, False]),
        ([LEFT], [LEFT, LEFT], [1.0, 1.0], [False, True]),
        ([LEFT], [LEFT, (-0.23, 2.42)], [2.0, 1.0], [False, True]),
        ([LEFT, RIGHT], [LEFT, RIGHT, LEFT, None, RIGHT], [3.0, 0.0, 2.0, 9.0, 1.0], [0, 1, 1, 0, 0]),
    ],
    ids=["side by side", "the newer one", "the later number", "not quite at the same place", "two pairs"],
)
def test_of_two_bodies_on_one_person_the_one_known_for_longer_stays(
    people: list[tuple[float, float]],
    bodies: list[tuple[float, float] | None],
    known_s: list[float],
    away: list[bool],
) -> None:
    """Bodies on people of their own stay, also if the people stand side by side."""
    assert explained_away(counted(people, bodies), known_s, MIN_SHARE) == away


def test_a_body_beside_the_person_goes_though_it_was_known_for_longer() -> None:
    """A body half beside a person is explained by the body that fits; not the other way round."""
    counts = counted([LEFT], [(LEFT[0] + 0.17, LEFT[1]), LEFT])
    assert explained_away(counts, [9.0, 0.0], MIN_SHARE) == [True, False]


def test_three_bodies_leave_one() -> None:
    """Each pair explains each other: the one known for longest stays."""
    assert explained_away(np.full((3, 3), 100.0), [1.0, 3.0, 2.0], MIN_SHARE) == [True, False, True]


def test_bodies_that_show_nothing_are_not_explained_away() -> None:
    """There is no evidence that another body could explain."""
    assert explained_away(np.zeros((2, 2)), [1.0, 2.0], MIN_SHARE) == [False, False]
