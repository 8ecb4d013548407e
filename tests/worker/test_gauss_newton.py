"""Normal equations and their solution: what moments give is what the whole Jacobian gives."""

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
    POINTS,
    SETTINGS,
    near,
    posed_in,
    starts,
    subject,
    tangents,
)
from worker.kernel.correspondence import find_correspondences
from worker.kernel.gauss_newton import minimise, solve_ltl
from worker.kernel.icp import solver_parameters
from worker.kernel.normal_equations import normal_equations, subtree_moments
from worker.kernel.observation import observe, pack_observation
from worker.kernel.parameters import pack_parameters
from worker.kernel.surface import pack_model
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import NormalEquations, make_equations

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


def summed(model: BodyModel, factors: plain_path.Factors) -> tuple[Array, Array]:
    """Moments (L, 4, 4) and crosses (L, 4, 3) of factors."""
    x = np.column_stack([factors.points, np.ones(len(factors.points))])
    links = len(model.link_names)
    moments, crosses = np.zeros((links, 4, 4)), np.zeros((links, 4, 3))
    np.add.at(moments, factors.links, np.einsum("n,na,nb->nab", factors.weights, x, x))
    np.add.at(crosses, factors.links, np.einsum("n,na,nb->nab", factors.weights, x, factors.targets))
    return moments, crosses


def kernel_equations(
    model: BodyModel, factors: plain_path.Factors, pose: Array, metric: Array
) -> tuple[Array, Array]:
    """J^T J (D, D) and J^T r (D,) from the moments of factors, at a pose that the body has moved on to."""
    skeleton, _ = pack_model(model)
    equations = summed_up(model, factors)
    equations.reference[:], equations.moved[:] = (
        dof_transforms(model, p[None])[0] for p in (factors.pose, pose)
    )
    subtree_moments(skeleton, equations)
    normal_equations(skeleton, metric, equations)
    return equations.gram, equations.gradient


def summed_up(model: BodyModel, factors: plain_path.Factors) -> NormalEquations:
    """Buffers of equations with the sums of factors, used before."""
    equations = make_equations(len(model.dof_names), len(model.link_names))
    for array in equations:
        array.fill(7)
    equations.moments[:], equations.crosses[:] = summed(model, factors)
    return equations


@pytest.mark.parametrize("name", SETTINGS)
def test_moments_match(name: str) -> None:
    """What the kernel collects, free space and robust weights included, is the sum over the plain factors."""
    model, settings = puppet(), SETTINGS[name]
    pose = near()
    skeleton, surface = pack_model(model)
    packed, parameters = pack_observation(observe(subject()), settings), pack_parameters(settings)
    workspace, _, visible = posed_in(model, pose, settings)
    find_correspondences(visible, 0, surface, packed, workspace)
    accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
    found = workspace.equations.moments, workspace.equations.crosses
    factors = plain_path.weigh_correspondences(
        model, pose, *plain_path.visible_vertices(model, pose), subject(), settings
    )
    assert len(factors.weights) > POINTS
    for total, expected in zip(found, summed(model, factors), strict=True):
        np.testing.assert_allclose(total, expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("blended", [True, False])
@pytest.mark.parametrize("moved", [0.0, 0.2])
@pytest.mark.parametrize("along", [1.0, 0.25])
def test_normal_equations_match(blended: bool, moved: float, along: float) -> None:
    """From moments come the J^T J and J^T r that the whole Jacobian gives, in any metric, after moves too."""
    model = puppet(blended)
    start = near()
    settings = msgspec.structs.replace(PAPER, noise_depth=PAPER.noise_lateral / along)
    factors = plain_path.split_by_link(model, start, *correspondences(model, start, settings))
    pose = retract(model, start[None], np.full((1, len(start)), moved))[0]
    gram, gradient = kernel_equations(model, factors, pose, np.array([1.0, 1.0, along**2]))
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

    gram, gradient = kernel_equations(model, factors, start, np.ones(3))
    np.testing.assert_allclose(gradient, tangents(model, start, cost), rtol=1e-5, atol=1e-5)
    matrix = tangents(model, start, blend)
    exact = np.einsum("n,nij,nik->jk", weights, matrix, matrix)
    assert np.linalg.eigvalsh(gram - exact).min() > -1e-4
    assert np.abs(gram - exact).max() < 0.1 * np.abs(exact).max()


@pytest.mark.parametrize("name", SETTINGS)
def test_minimising_matches(name: str) -> None:
    """Step 4d on the same factors: damping, rest and limits included, the same pose to 1e-7."""
    model, settings = puppet(), SETTINGS[name]
    skeleton, _ = pack_model(model)
    for start in starts(2):
        start = plain_path.clamp_to_limits(model, start)  # noqa: PLW2901
        factors = plain_path.weigh_correspondences(
            model, start, *plain_path.visible_vertices(model, start), subject(), settings
        )
        pose = start.copy()
        solver = solver_parameters(pack_parameters(settings), POINTS)
        transforms = np.concatenate([dof_transforms(model, pose[None])[0], np.eye(4)[None, :3]])
        minimise(skeleton, pose, transforms, solver, summed_up(model, factors))
        assert np.abs(pose - start).max() > 0.05
        np.testing.assert_allclose(pose, plain_path.minimise(model, factors, POINTS, settings), atol=1e-7)


def test_what_nothing_determines_stays() -> None:
    """Without damping: steps of a singular system are finite, solve it, and leave the undetermined alone."""
    jacobian = np.random.default_rng(0).normal(size=(3, 5)) * [1.0, 1.0, 0.0, 1.0, 1.0]
    gram, target = jacobian.T @ jacobian, jacobian.T @ np.array([0.3, -0.2, 0.1])
    step = target.copy()
    solve_ltl(np.arange(-1, 4), gram.copy(), step)
    assert step[2] == 0.0
    assert np.abs(step).max() < 100.0
    np.testing.assert_allclose(gram @ step, target, atol=1e-9)
