"""Laws of all terms of the log posterior. A new term is a line in TERMS: its cost in plain numpy."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.kinematics import difference, pose_vertices, within_limits
from gepf.common.refinement import Particles, PosePrior, lower_triangular
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.normal_equations import move_wrenches
from gepf.worker.kernel.observation import observe
from tests.support.kernel import plain_path
from tests.support.kernel.equations import KernelAt
from tests.support.kernel.posterior import (
    BODIES,
    COLOUR,
    SETTINGS,
    Held,
    PosteriorCase,
    finite_differences,
    free_space_cost,
    keypoint_cost,
    log_density,
    point_cost,
    posterior_case,
    random_poses,
)

Cost = Callable[[Held, PosePrior, Array], Array]
"""The cost (N,) of poses (N, D) in nats, without its weight per point."""


def depth(held: Held, _: PosePrior, poses: Array) -> Array:
    """Half the mean robust squared distance of the points in units of the scale."""
    return 0.5 * point_cost(held, pose_vertices(held.model, poses)) / held.settings.likelihood_scale**2


def free_space(held: Held, _: PosePrior, poses: Array) -> Array:
    """The same of visible vertices from the outline."""
    return 0.5 * free_space_cost(held, pose_vertices(held.model, poses)) / held.settings.likelihood_scale**2


def soft(held: Held, _: PosePrior, poses: Array) -> Array:
    """Minus the mean log density of the points, for the independent ones."""
    assert held.samples is not None
    density = log_density(held, held.samples, poses).mean(axis=1)
    return np.asarray(-held.settings.independent_points * density)


def keypoints(held: Held, _: PosePrior, poses: Array) -> Array:
    """Half the robust squared distances in the image, in deviations."""
    return keypoint_cost(held, poses)


def limits(held: Held, _: PosePrior, poses: Array) -> Array:
    """Balls beyond their limits."""
    rules = msgspec.structs.replace(held.settings, pose_deviation=0.0)
    return 0.5 * plain_path.prior_costs(held.model, poses, rules) * plain_path.nats(held.settings)


def prior(held: Held, given: PosePrior, poses: Array) -> Array:
    """Half the squared distance from the mean."""
    away = difference(held.model, given.mean[None], poses)
    return np.asarray(0.5 * np.einsum("ni,ij,nj->n", away, given.precision, away))


HARD: dict[str, Cost] = {"depth": depth, "free_space": free_space}
TERMS: dict[str, dict[str, Cost]] = {
    name: ({"soft": soft} if settings.is_soft else HARD) | {"limits": limits, "prior": prior}
    for name, settings in SETTINGS.items()
}
TERMS[COLOUR]["keypoints"] = keypoints
CASES = [(body, name, term) for body in BODIES for name, its in TERMS.items() for term in its]
POSES = 3


def dense_prior(of: PosteriorCase) -> PosePrior:
    """About a pose off the truth, with correlations between all degrees of freedom."""
    rng, dofs = np.random.default_rng(3), len(of.truth)
    mixed = rng.normal(size=(dofs, dofs))
    return PosePrior(of.truth + 0.4 * rng.normal(size=dofs), mixed @ mixed.T)


def kernels(body: str, name: str) -> list[KernelAt]:
    """The kernel at random poses, in the last of them with balls beyond their limits."""
    of = posterior_case(body, name)
    poses, lowest = random_poses(of, POSES), of.model.limits[:, 0]
    for start in of.model.balls[np.isfinite(lowest[of.model.balls])]:
        poses[-1, [start, start + 2]] = lowest[[start, start + 2]] - (0.1, 0.2)
    return [KernelAt.make(of, pose, dense_prior(of)) for pose in poses]


@pytest.mark.parametrize(("body", "name", "term"), CASES)
def test_a_term_is_its_cost_and_its_derivatives(body: str, name: str, term: str) -> None:
    """Its cost is that in plain numpy, its gradient the finite differences of that, to 1e-4.

    Its Gauss-Newton matrix is positive semidefinite. Correspondences, samples and visible vertices are held.
    """
    costs = list[float]()
    for whole in kernels(body, name):
        kernel, held, given = whole.only(term), whole.held(), dense_prior(whole.of)

        def cost(poses: Array, held: Held = held, given: PosePrior = given) -> Array:
            return TERMS[name][term](held, given, poses)

        costs.append(kernel.cost())
        assert costs[-1] == pytest.approx(cost(kernel.pose[None])[0], rel=1e-3, abs=1e-9)
        gram, gradient = kernel.linearise()
        exact = finite_differences(kernel.of.model, kernel.pose, cost)
        assert np.linalg.norm(gradient - exact) <= 1e-4 * np.linalg.norm(exact) + 1e-6
        assert np.linalg.eigvalsh(gram)[0] >= -1e-9 * np.abs(gram).max()
    assert any(costs) or (name, term) == ("paper", "free_space")


@pytest.mark.parametrize(("body", "name"), [(body, name) for body in BODIES for name in TERMS])
def test_terms_add_up(body: str, name: str) -> None:
    """Costs, gradients and matrices: together they are the sums of those alone, and the log posterior."""
    for whole in kernels(body, name):
        alone = [whole.only(term) for term in TERMS[name]]
        assert whole.cost() == pytest.approx(sum(kernel.cost() for kernel in alone), rel=1e-12)
        parts, together = [kernel.linearise() for kernel in alone], whole.linearise()
        for summed, total in zip(map(sum, zip(*parts, strict=True)), together, strict=True):
            np.testing.assert_allclose(total, summed, rtol=0.0, atol=1e-9 * np.abs(total).max())
        still = msgspec.structs.replace(whole.of.settings, icp_iterations=0)
        asked = Particles(whole.pose[None], still, prior=dense_prior(whole.of))
        found = refine(whole.of.model, observe(whole.of.subject), asked)
        assert -found.log_likelihood[0] == pytest.approx(whole.cost(), rel=1e-9)


@pytest.mark.parametrize("body", BODIES)
def test_wrenches_follow_a_step(body: str) -> None:
    """Of a term that has no sums over targets: the gradient changes by the matrix times the step."""
    (kernel, *_) = (whole.only("soft") for whole in kernels(body, "soft"))
    step = 0.01 * np.random.default_rng(4).normal(size=len(kernel.pose))
    gram, before = kernel.linearise()
    move_wrenches(kernel.view.problem.skeleton, step, kernel.view.workspace.equations)
    np.testing.assert_allclose(kernel.fill()[1], before + gram @ step, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("dense", [False, True])
def test_a_strong_prior_decides_and_is_the_covariance(dense: bool) -> None:
    """Particles with means of their own go to them, and are as certain as the prior says."""
    of = posterior_case("person", "default")
    rng, dofs, variance = np.random.default_rng(5), len(of.truth), 1e-10
    means = within_limits(of.model, of.truth + 0.05 * rng.normal(size=(POSES, dofs)))
    mixed = np.eye(dofs) + dense * 0.1 * rng.normal(size=(dofs, dofs))
    precision = mixed @ mixed.T / variance if dense else np.full(dofs, 1.0 / variance)
    many = msgspec.structs.replace(of.settings, icp_iterations=20)
    asked = Particles(np.tile(of.truth, (POSES, 1)), many, True, prior=PosePrior(means, precision))
    found = refine(of.model, observe(of.subject), asked)
    assert np.abs(difference(of.model, found.poses, means)).max() < 1e-4
    assert found.covariance_roots is not None
    for root in lower_triangular(found.covariance_roots, dofs):
        expected = np.linalg.inv(mixed @ mixed.T)
        np.testing.assert_allclose(root @ root.T / variance, expected, atol=1e-3 * expected.max())
