"""Closest points, exactly: the search by blocks against scipy's tree, for clouds of every kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.worker.kernel.correspondence import closest_points
from gepf.worker.kernel.observation import TILE, Observation, ObservedView, pack_views, view_of
from gepf.worker.kernel.surface import LEAF
from gepf.worker.kernel.workspace import make_search
from tests.support.kernel.kernel_cases import PAPER

Points = NDArray[np.float32]
Cloud = Callable[[np.random.Generator, int], Array]


def scattered(rng: np.random.Generator, count: int) -> Array:
    """Anywhere in a room."""
    return rng.uniform(-2.0, 2.0, size=(count, 3))


def clustered(rng: np.random.Generator, count: int) -> Array:
    """In a few dense spots far apart."""
    return 2.0 * rng.normal(size=(4, 3))[rng.integers(4, size=count)] + 0.005 * rng.normal(size=(count, 3))


def coplanar(rng: np.random.Generator, count: int) -> Array:
    """On a wall, where boxes have no depth."""
    return np.column_stack([rng.uniform(-1.0, 1.0, size=(count, 2)), np.full(count, 2.0)])


def in_line(rng: np.random.Generator, count: int) -> Array:
    """On a straight line."""
    return np.asarray(rng.uniform(-1.0, 1.0, size=(count, 1)) * np.array([0.6, 0.0, 0.8]))


def at_one_point(_: np.random.Generator, count: int) -> Array:
    """All in the same place."""
    return np.tile([0.1, -0.2, 1.5], (count, 1))


def repeated(rng: np.random.Generator, count: int) -> Array:
    """A few places, each many times."""
    return scattered(rng, 5)[rng.integers(5, size=count)]


def on_a_grid(rng: np.random.Generator, count: int) -> Array:
    """Whole decimetres, so that many distances are equal."""
    return np.asarray(rng.integers(-4, 5, size=(count, 3)) / 10.0)


CLOUDS = st.sampled_from([scattered, clustered, coplanar, in_line, at_one_point, repeated, on_a_grid])


def in_order(cloud: Array) -> Array:
    """From left to right."""
    return cloud[np.argsort(cloud[:, 0], kind="stable")]


def single(cloud: Array) -> Points:
    """In the kernel's precision."""
    return cloud.astype(np.float32)


def search(
    observed: Points, model: Points, guess: NDArray[np.uint32] | None = None
) -> tuple[NDArray[np.uint32], Points]:
    """Indices (P,) and squared distances (P,) as the kernel finds them, from a guess (P,) if there is one."""
    nothing = np.zeros((1, 1), np.bool_), np.zeros((2, 1, 1), np.int32)
    camera = Intrinsics(1, 1, 1.0, 1.0, 0.0, 0.0)
    points = np.concatenate([observed, np.repeat(observed[-1:], -len(observed) % TILE, axis=0)])
    of = ObservedView(points, len(observed), *nothing, camera, np.zeros(4, int), np.eye(4)[:3], 0.0)
    packed = view_of(pack_views(Observation((of,)), PAPER), 0)
    assert PAPER.noise_lateral == PAPER.noise_depth  # so depth is not scaled
    leaves = -(-len(model) // LEAF)
    found = make_search(len(model), leaves, len(points))
    for array in found:
        array.fill(7)  # whatever an earlier search left
    found.model[:] = model
    found.starts[:] = np.minimum(np.arange(leaves + 1) * LEAF, len(model))
    if guess is not None:
        found.closest[:] = np.resize(guess, len(points))
    closest_points(packed, leaves, guess is not None, found)
    return found.closest[: len(observed)], found.squared[: len(observed)]


@given(CLOUDS, CLOUDS, st.integers(1, 300), st.integers(1, 3000), st.booleans(), st.integers(0, 2**32 - 1))
@example(scattered, scattered, 1, 1, True, 0)
@example(clustered, clustered, 64, 8, True, 0)
@example(scattered, coplanar, 65, 9, False, 0)
@example(at_one_point, at_one_point, 64, 8, True, 0)
@example(scattered, scattered, 300, 3000, True, 0)
@example(scattered, scattered, 10_000, 2_000, True, 0)  # as large as in use
def test_the_closest_point_is_the_closest(
    observed_like: Cloud, model_like: Cloud, points: int, others: int, ordered: bool, seed: int
) -> None:
    """For any clouds and order: no point is nearer than the one found, and its distance is right.

    In ordered clouds the same points are found from any guess: the closest points themselves, one for all, or
    any. So the guess may be that of another particle, whichever the lane refined before.
    """
    rng = np.random.default_rng(seed)
    clouds = observed_like(rng, points), model_like(rng, others)
    observed, model = (single(in_order(cloud) if ordered else cloud) for cloud in clouds)
    index, squared = search(observed, model)
    nearest, _ = cKDTree(model.astype(np.float64)).query(observed.astype(np.float64))
    found = np.linalg.norm(observed.astype(np.float64) - model[index], axis=1)
    np.testing.assert_allclose(found, nearest, atol=2e-6)
    np.testing.assert_allclose(np.sqrt(squared), nearest, atol=2e-6)
    if not ordered:
        observed, model = (single(in_order(cloud)) for cloud in clouds)
        index, squared = search(observed, model)
    for guess in (index, np.zeros_like(index), rng.integers(others, size=points).astype(np.uint32)):
        again, apart = search(observed, model, guess)
        np.testing.assert_array_equal(again, index)
        np.testing.assert_array_equal(apart, squared)
