"""Every derivative that the kernel writes down, against finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import difference, pose_vertices, step_axes
from tests.support.bodies import moves, puppet
from tests.support.kernel.kernel_cases import tangents
from worker.kernel.normal_equations import jacobian_matrix
from worker.kernel.priors import add_limit_prior, add_rest_prior
from worker.kernel.surface import Skeleton, pack_model

Array = NDArray[np.float64]
Prior = Callable[[Skeleton, Array, float, Array, Array], None]

STIFFNESS = 0.7


def bent() -> Array:
    """A pose (19,) of the puppet with every joint turned, balls far from gimbal lock."""
    pose: Array = np.random.default_rng(5).uniform(-0.8, 0.8, size=19)
    return pose


def prior_equations(add: Prior, model: BodyModel, pose: Array) -> tuple[Array, Array]:
    """J^T J (D, D) and J^T r (D,) that a prior adds to equations that are zero."""
    gram, gradient = np.zeros((len(pose), len(pose))), np.zeros(len(pose))
    add(pack_model(model)[0], pose.copy(), STIFFNESS, gram, gradient)
    return gram, gradient


def test_jacobian_matrices_are_the_derivatives_of_points() -> None:
    """Eq. 2: A_j [p; 1] is how a vertex moves with degree of freedom j, wherever j moves its link."""
    model, pose = puppet(blended=False), bent()
    w, q = (axes[0] for axes in step_axes(model, pose[None]))
    exact = tangents(model, pose, lambda at: pose_vertices(model, at[None])[0])  # (V, 3, D)
    points = np.column_stack([pose_vertices(model, pose[None])[0], np.ones(len(model.vertices))])
    moved = moves(model)[:, model.skin_links[:, 0]]  # (D, V)
    column = np.empty((3, 4))
    for j in range(len(pose)):
        jacobian_matrix(int(model.kinds[j]), w[j], q[j], column)
        expected = np.where(moved[j][:, None], points @ column.T, 0.0)
        np.testing.assert_allclose(exact[:, :, j], expected, atol=1e-8)


def test_the_rest_prior_is_the_slope_of_its_cost() -> None:
    """Its J^T r is the derivative of half the squared way from rest, balls of either hand included."""
    model, pose = puppet(), bent()
    joints = pack_model(model)[0].precisions > 0.0

    def cost(at: Array) -> Array:
        way = difference(model, np.zeros((1, len(at))), at[None])[0]
        return np.asarray(0.5 * STIFFNESS * np.sum(way[joints] ** 2))

    _, gradient = prior_equations(add_rest_prior, model, pose)
    assert np.abs(gradient[joints]).min() > 1e-3
    np.testing.assert_allclose(gradient, tangents(model, pose, cost), atol=1e-8)


def test_the_limit_prior_is_the_slope_of_its_cost() -> None:
    """Its J^T r and J^T J are those of the balls' angles beyond their limits."""
    model = puppet()
    low, high = model.limits.T
    balls = np.zeros(len(low), dtype=bool)
    balls[(model.balls[:, None] + np.arange(3)).ravel()] = True
    pose = np.where(balls & np.isfinite(high), high + 0.1, bent())

    def excess(at: Array) -> Array:
        beyond: Array = np.where(balls, at - np.clip(at, low, high), 0.0)
        return beyond

    gram, gradient = prior_equations(add_limit_prior, model, pose)
    usable = [start for start in model.balls if abs(np.cos(pose[start + 1])) > 0.3]
    at = np.concatenate([np.arange(start, start + 3) for start in usable])
    rates = tangents(model, pose, excess)[at][:, at]
    assert np.count_nonzero(excess(pose)[at]) >= 3
    np.testing.assert_allclose(gradient[at], STIFFNESS * rates.T @ excess(pose)[at], atol=1e-8)
    np.testing.assert_allclose(gram[np.ix_(at, at)], STIFFNESS * rates.T @ rates, atol=1e-7)
