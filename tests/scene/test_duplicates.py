"""Duplicate bodies: which of two bodies on one person stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gepf.coordinator.scene.duplicates import Evidence, evidence_of, find_duplicates
from gepf.coordinator.scene.scene import Scene
from gepf.coordinator.scene.segmentation import measure_distances
from gepf.coordinator.settings import SceneSettings, SegmentationSettings
from tests.support.rooms import Room

MIN_SHARE = 0.2
LEFT, RIGHT = (-0.25, 2.4), (0.25, 2.6)
Place = tuple[float, float]


def evidence(people: list[Place], bodies: list[Place | None]) -> Evidence:
    """The evidence for bodies in a room with people."""
    room = Room(noise=0.001)
    seen = [room.see(place).view for place in people]
    view = Scene(SceneSettings()).observe(
        replace(seen[0], depth=np.minimum.reduce([one.depth for one in seen]))
    )
    surfaces = [None if place is None else room.surface(place) for place in bodies]
    return evidence_of(view, [None if one is None else measure_distances(view, one) for one in surfaces])


@pytest.mark.parametrize(
    ("people", "bodies", "followed_s", "duplicates"),
    [
        ([LEFT, RIGHT], [LEFT, RIGHT], [1.0, 2.0], [False, False]),
        ([LEFT], [LEFT, LEFT], [1.0, 2.0], [True, False]),
        ([LEFT], [LEFT, LEFT], [1.0, 1.0], [False, True]),
        ([LEFT], [LEFT, (-0.23, 2.42)], [2.0, 1.0], [False, True]),
        ([LEFT, RIGHT], [LEFT, RIGHT, LEFT, None, RIGHT], [3.0, 0.0, 2.0, 9.0, 1.0], [0, 1, 1, 0, 0]),
        ([LEFT], [LEFT, LEFT, LEFT], [1.0, 3.0, 2.0], [True, False, True]),
        ([LEFT, RIGHT], [LEFT, (0.0, 2.5), RIGHT], [0.0, 9.0, 0.0], [False, True, False]),
    ],
    ids=[
        "side by side", "the newer one", "the later number", "not quite at the same place", "two pairs",
        "three",
        "between two people",
    ],
)  # fmt: skip
def test_of_bodies_on_one_person_the_one_followed_for_longest_stays(
    people: list[Place], bodies: list[Place | None], followed_s: list[float], duplicates: list[bool]
) -> None:
    """Bodies on people of their own stay, also if the people stand side by side."""
    assert find_duplicates([evidence(people, bodies)], followed_s, MIN_SHARE) == duplicates


def test_bodies_that_both_trail_the_person_are_duplicates() -> None:
    """The person has moved by 10 cm since the last frame: neither of them is at the person now."""
    seen = evidence([(LEFT[0] + 0.1, LEFT[1])], [LEFT, LEFT])
    assert find_duplicates([seen], [2.0, 1.0], MIN_SHARE) == [False, True]


def test_a_body_beside_the_person_goes_though_it_was_followed_for_longer() -> None:
    """A body half beside a person is explained by the body that fits, but not the other way round."""
    seen = evidence([LEFT], [(LEFT[0] + 0.17, LEFT[1]), LEFT])
    assert find_duplicates([seen], [9.0, 0.0], MIN_SHARE) == [True, False]


def test_a_body_that_is_hidden_in_one_image_stays_if_another_image_shows_it() -> None:
    """The pixels of all cameras count together."""
    hidden, shown = evidence([LEFT], [LEFT, LEFT]), evidence([LEFT, RIGHT], [LEFT, RIGHT])
    assert find_duplicates([hidden, shown], [2.0, 1.0], MIN_SHARE) == [False, False]


def test_a_body_without_pixels_is_no_duplicate() -> None:
    """There is nothing that another body could explain."""
    far = np.full((2, 4, 4), np.inf, dtype=np.float32)
    nothing = Evidence(np.isfinite(far), far, SegmentationSettings())
    assert find_duplicates([nothing], [1.0, 2.0], MIN_SHARE) == [False, False]
