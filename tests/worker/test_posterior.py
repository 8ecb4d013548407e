"""One log posterior: what the descent climbs is what the weight is, prior, free space and all.

The kernel's equations and its weights are held against `tests/support/kernel/posterior.py`.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import DEFAULT
from tests.support.kernel.posterior import (
    BODIES,
    SETTINGS,
    Held,
    PosteriorCase,
    hold,
    log_posterior,
    posterior_case,
    random_poses,
    slope,
)
from worker.kernel.correspondence import find_correspondences
from worker.kernel.gauss_newton import fill_equations
from worker.kernel.icp import refine, solver_parameters
from worker.kernel.observation import observe, pack_observation
from worker.kernel.parameters import pack_parameters
from worker.kernel.soft import fill_soft_equations, sample, sample_distance
from worker.kernel.surface import pack_model
from worker.kernel.visibility import update_visibility
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import make_workspace

Array = NDArray[np.float64]

MANY, FEW = 200, 6


def kernel_slope(of: PosteriorCase, pose: Array) -> tuple[Array, Held]:
    """Minus the right side of the descent's equations as a slope (D,) of the log posterior; what it held."""
    skeleton, surface = pack_model(of.model)
    packed, parameters = pack_observation(observe(of.subject), of.settings), pack_parameters(of.settings)
    workspace = make_workspace(skeleton, surface, packed)
    equations = workspace.equations
    if parameters.soft:
        fill_soft_equations(pose, skeleton, surface, packed, parameters, workspace)
        grid = sample(workspace.visibility, surface, sample_distance(parameters), workspace.soft)
        scale = of.settings.independent_points / of.settings.noise_lateral**2
        held = hold(of.model, pose, of.subject, of.settings, grid)
        return -scale / packed.count * equations.gradient, held
    visible = update_visibility(pose, skeleton, surface, workspace.transforms, workspace.visibility)
    find_correspondences(visible, 0, surface, packed, workspace)
    accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
    equations.reference[:] = equations.moved[:] = workspace.transforms[:-1]
    fill_equations(skeleton, pose, solver_parameters(parameters, packed.count), equations)
    scale = of.settings.likelihood_scale**2
    return -equations.gradient / (packed.count * scale), hold(of.model, pose, of.subject, of.settings)


HOW_MANY = pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])


@HOW_MANY
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_the_descent_climbs_the_log_posterior(body: str, name: str, count: int) -> None:
    """Its right side is the log posterior's slope by finite differences, to 1e-4, at poses near and far."""
    of = posterior_case(body, name)
    for pose in random_poses(of, count):
        mine, held = kernel_slope(of, pose.copy())
        exact = slope(held, pose)
        assert np.linalg.norm(mine - exact) < 1e-4 * np.linalg.norm(exact)


@HOW_MANY
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_every_weight_is_the_log_posterior_of_the_pose_that_comes_with_it(
    body: str, name: str, count: int
) -> None:
    """Of refined particles: by what is visible in the pose itself, and belongs together there."""
    of = posterior_case(body, name)
    refined = refine(of.model, observe(of.subject), random_poses(of, count), of.settings)
    for pose, weight in zip(refined.poses, refined.log_likelihood, strict=True):
        held = kernel_slope(of, pose.copy())[1]
        assert weight == pytest.approx(log_posterior(held, pose[None])[0], rel=1e-3)


def test_far_from_rest_is_less_likely() -> None:
    """Of two poses that explain a frame alike, the one nearer to rest weighs more, by what the prior says."""
    model, near, far = puppet(), np.zeros(19), np.zeros(19)
    far[model.dof("head_nod")] = 0.5
    settings = msgspec.structs.replace(DEFAULT, pose_deviation=0.8)
    costs = plain_path.prior_costs(model, np.stack([near, far]), settings)
    nats = -0.5 * np.diff(costs)[0] / settings.likelihood_scale**2
    assert nats == pytest.approx(-0.5 * (0.5 / 0.8) ** 2)
