"""When three rotations form a ball."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from common.body import ROTATION, TRANSLATION, find_balls

THROUGH_ONE_POINT = np.zeros((4, 3))


def balls_of(
    parents: list[int],
    carriers: list[int],
    axes: NDArray[np.float64] | None = None,
    kinds: list[int] | None = None,
) -> list[int]:
    """Balls among rotations about x, y, z and x again."""
    count = len(parents)
    balls = find_balls(
        np.array(kinds or [ROTATION] * count, dtype=np.int64),
        np.array(parents, dtype=np.int64),
        np.eye(3)[np.arange(count) % 3] if axes is None else axes,
        THROUGH_ONE_POINT[:count],
        np.array(carriers, dtype=np.int64),
    )
    return [int(ball) for ball in balls]


SLANTED = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("balls", "found"),
    [
        (balls_of([-1, 0, 1], [2]), [0]),  # a shoulder: one link, on the last of the three
        (balls_of([-1, 0, 1], [0, 2]), []),  # a robot's wrist: what hangs on the first axis moves on its own
        (balls_of([-1, 0, 1], [1, 2]), []),
        (balls_of([-1, 0, 1, 0], [2, 3]), []),  # a second child of the first axis
        (balls_of([-1, 0, 1, 1], [2, 3]), []),
        (balls_of([-1, 0, 1], [2], SLANTED), []),
        (balls_of([-1, 0, 1], [2], kinds=[ROTATION, TRANSLATION, ROTATION]), []),
    ],
)
def test_three_rotations_in_one_point_with_nothing_in_between_are_a_ball(
    balls: list[int], found: list[int]
) -> None:
    """Only orthonormal axes are solved as one turn, and only where no surface or joint is in between."""
    assert balls == found
