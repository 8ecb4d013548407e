"""Normal equations and their solution: what sums give is what the whole Jacobian gives."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import dof_transforms, retract
from common.settings import RefineSettings
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import (
    DEFAULT,
    PAPER,
    near,
    posed_in,
    subject,
    tangents,
)
from worker.kernel.gauss_newton import solve_ltl
from worker.kernel.normal_equations import fill_normal_equations
from worker.kernel.surface import pack_model

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def correspondences(
    model: BodyModel, pose: Array, settings: RefineSettings
) -> tuple[Array, Indices, Array, Array]:
    """Vertices (V, 3) in a pose, and for each correspondence vertex (n,), target (n, 3), weight (n,)."""
    posed, visible = plain_path.visible_vertices(model, pose)
    points = plain_path.observed_points(subject())
    index, squared = plain_path.closest_points(points, posed[visible], settings)
    return posed, visible[index], points, plain_path.robust_weight(squared, settings)


def summed(model: BodyModel, factors: plain_path.Factors) -> Array:
    """M and C (L, 4, 7) of factors, side by side."""
    rest = plain_path.move_with_links(model, factors, np.zeros_like(factors.pose))
    x = np.column_stack([rest, np.ones(len(rest))])
    sums = np.zeros((len(model.link_names), 4, 7))
    both = np.column_stack([x, factors.targets])
    np.add.at(sums, factors.links, np.einsum("n,na,nb->nab", factors.weights, x, both))
    return sums


def kernel_equations(
    model: BodyModel, factors: plain_path.Factors, pose: Array, stretch: float
) -> tuple[Array, Array]:
    """J^T J (D, D) and J^T r (D,) from the sums of factors, at a pose that the body has moved on to."""
    skeleton, _ = pack_model(model)
    equations = posed_in(model, factors.pose, PAPER)[0].equations  # used before
    equations.sums[:] = summed(model, factors)
    fill_normal_equations(skeleton, transforms_of(model, pose), stretch, equations)
    return equations.gram, equations.gradient


def transforms_of(model: BodyModel, pose: Array) -> Array:
    """T_camera_rest (D + 1, 3, 4), the last for links that nothing moves."""
    return np.concatenate([dof_transforms(model, pose[None])[0], np.eye(4)[None, :3]])


@pytest.mark.parametrize("blended", [True, False])
@pytest.mark.parametrize("moved", [0.0, 0.2])
@pytest.mark.parametrize("along", [1.0, 0.25])
def test_normal_equations_match(blended: bool, moved: float, along: float) -> None:
    """The sums give the J^T J and J^T r of the whole Jacobian, in any metric, after moves too."""
    model = puppet(blended)
    start = near()
    settings = msgspec.structs.replace(PAPER, noise_depth=PAPER.noise_lateral / along)
    factors = plain_path.split_by_link(model, start, *correspondences(model, start, settings))
    pose = retract(model, start[None], np.full((1, len(start)), moved))[0]
    gram, gradient = kernel_equations(model, factors, pose, along)
    expected_gram, expected = plain_path.equations(model, factors, pose, settings)
    np.testing.assert_allclose(gram, expected_gram, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-7)


def test_shared_skin_leaves_the_gradient_exact_and_steps_safe() -> None:
    """Of vertices that several links carry on: J^T r is exact at the pose of the search, J^T J no smaller."""
    model = puppet()
    start = near()
    posed, vertices, targets, weights = correspondences(model, start, DEFAULT)
    factors = plain_path.split_by_link(model, start, posed, vertices, targets, weights)
    rows = np.repeat(np.arange(len(vertices)), np.count_nonzero(model.skin_weights[vertices], axis=1))
    shares = factors.weights / weights[rows]
    assert np.mean(shares < 0.9) > 0.05

    def blend(at: Array) -> Array:
        mixed = np.zeros((len(vertices), 3))
        np.add.at(mixed, rows, shares[:, None] * plain_path.move_with_links(model, factors, at))
        return mixed

    def cost(at: Array) -> Array:
        return np.asarray(0.5 * np.sum(weights[:, None] * (blend(at) - targets) ** 2))

    gram, gradient = kernel_equations(model, factors, start, 1.0)
    np.testing.assert_allclose(gradient, tangents(model, start, cost), rtol=1e-5, atol=1e-5)
    matrix = tangents(model, start, blend)
    exact = np.einsum("n,nij,nik->jk", weights, matrix, matrix)
    assert np.linalg.eigvalsh(gram - exact).min() > -1e-4
    assert np.abs(gram - exact).max() < 0.1 * np.abs(exact).max()


def test_what_nothing_determines_stays() -> None:
    """Without damping: steps of a singular system are finite, solve it, and leave the undetermined alone."""
    jacobian = np.random.default_rng(0).normal(size=(3, 5)) * [1.0, 1.0, 0.0, 1.0, 1.0]
    gram, target = jacobian.T @ jacobian, jacobian.T @ np.array([0.3, -0.2, 0.1])
    step = target.copy()
    solve_ltl(np.arange(-1, 4), gram.copy(), step)
    assert step[2] == 0.0
    assert np.abs(step).max() < 100.0
    np.testing.assert_allclose(gram @ step, target, atol=1e-9)
