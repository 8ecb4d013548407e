"""What makes three rotations a ball."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from common.body import ROTATION, TRANSLATION, find_balls, surface_carriers

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


def test_three_rotations_through_one_point_are_a_ball() -> None:
    """A shoulder: one link, on the last of the three."""
    assert balls_of([-1, 0, 1], [2]) == [0]


@pytest.mark.parametrize("between", [0, 1])
def test_a_wrist_with_surface_in_between_is_no_ball(between: int) -> None:
    """A robot's spherical wrist: what hangs on the first or second axis moves on its own."""
    assert balls_of([-1, 0, 1], [between, 2]) == []


@pytest.mark.parametrize("branch", [0, 1])
def test_a_joint_in_between_keeps_rotations_apart(branch: int) -> None:
    """A second child on the first or second axis does too."""
    assert balls_of([-1, 0, 1, branch], [2, 3]) == []


def test_slanted_axes_and_translations_make_no_ball() -> None:
    """Only rotations about orthonormal axes are solved as one turn."""
    slanted = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, 0.0, 1.0]])
    assert balls_of([-1, 0, 1], [2], slanted) == []
    assert balls_of([-1, 0, 1], [2], kinds=[ROTATION, TRANSLATION, ROTATION]) == []


def test_carriers_are_what_surface_follows() -> None:
    """A link without vertices, or with weights of zero, carries nothing."""
    link_dofs = np.array([-1, 4, 2, 7])
    links, weights = np.array([[0, 1], [2, 3]]), np.array([[0.5, 0.5], [1.0, 0.0]])
    np.testing.assert_array_equal(surface_carriers(link_dofs, links, weights), [-1, 2, 4])
