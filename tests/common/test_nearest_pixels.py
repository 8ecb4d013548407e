"""The nearest occupied pixel is exact for any mask, and defined if nothing is occupied."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gepf.common.nearest_pixels import nearest_occupied_pixels


@given(st.integers(0, 2**32 - 1))
def test_no_occupied_pixel_is_nearer(seed: int) -> None:
    """The pixel named for each pixel is occupied, and no occupied pixel is nearer."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((30, 40)) < rng.uniform(0.0, 0.9)
    occupied[3, 5] = True
    nearest = nearest_occupied_pixels(occupied)
    assert np.all(occupied[tuple(nearest)])
    here = np.indices(occupied.shape).reshape(2, -1).T
    expected, _ = cKDTree(np.argwhere(occupied)).query(here)
    np.testing.assert_allclose(np.linalg.norm(nearest.reshape(2, -1).T - here, axis=1), expected)


@pytest.mark.parametrize("size", [(1, 1), (30, 40)])
def test_without_occupied_pixels_every_pixel_is_its_own(size: tuple[int, int]) -> None:
    """So nothing is pulled anywhere."""
    nearest = nearest_occupied_pixels(np.zeros(size, dtype=np.bool_))
    np.testing.assert_array_equal(nearest, np.indices(size))
    assert nearest.dtype == np.int32
