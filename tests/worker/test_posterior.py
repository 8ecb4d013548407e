"""One log posterior: the descent maximises the same value that is the weight, with all terms.

The kernel's equations and weights are compared with `tests/support/kernel/posterior.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.refinement import Particles
from gepf.worker.kernel.correspondence import find_correspondences
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.normal_equations import fill_normal_equations
from gepf.worker.kernel.observation import observe, pack_views, view_of
from gepf.worker.kernel.parameters import pack_parameters
from gepf.worker.kernel.priors import add_prior
from gepf.worker.kernel.soft import add_soft_equations
from gepf.worker.kernel.surface import pack_model
from gepf.worker.kernel.visibility import draw, pose_body, visible_vertices
from gepf.worker.kernel.weighting import accumulate_correspondences
from gepf.worker.kernel.workspace import make_workspaces
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

MANY, FEW = 200, 6


def kernel_slope(of: PosteriorCase, pose: Array) -> tuple[Array, Held]:
    """Minus the right side of the descent's equations as a slope (D,) of the log posterior; what it held."""
    skeleton, surface = pack_model(of.model)
    views, parameters = pack_views(observe(of.subject), of.settings), pack_parameters(of.settings)
    packed = view_of(views, 0)
    workspace, drawn = make_workspaces(skeleton, surface, views).shared, None
    equations = workspace.equations
    if parameters.soft:
        equations.gram[:], equations.gradient[:] = 0.0, 0.0
        add_soft_equations(pose, skeleton, surface, packed, parameters, workspace)
        drawn = draw(surface.triangles, True, workspace), surface
    else:
        pose_body(pose, skeleton, surface, workspace)
        visible = visible_vertices(surface, workspace)
        find_correspondences(visible, surface, packed, parameters.stretch, workspace)
        accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
        fill_normal_equations(skeleton, workspace.of_rig, parameters.stretch, equations)
    add_prior(skeleton, pose, parameters.rest_weight, packed.count, equations.gram, equations.gradient)
    held = hold(of.model, pose, of.subject, of.settings, drawn)
    return -parameters.posterior_scale / packed.count * equations.gradient, held


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_the_descent_climbs_the_log_posterior_and_weights_are_its_values(
    body: str, name: str, count: int
) -> None:
    """Its right side is the log posterior's slope by finite differences, to 1e-4, at poses near and far.

    The weight of each refined particle is the log posterior of its refined pose, with the visible vertices
    and the closest points of that pose.
    """
    of = posterior_case(body, name)
    poses = random_poses(of, count)
    for pose in poses:
        mine, held = kernel_slope(of, pose.copy())
        exact = slope(held, pose)
        assert np.linalg.norm(mine - exact) < 1e-4 * np.linalg.norm(exact)
    refined = refine(of.model, observe(of.subject), Particles(poses, of.settings))
    for pose, weight in zip(refined.poses, refined.log_likelihood, strict=True):
        held = kernel_slope(of, pose.copy())[1]
        assert weight == pytest.approx(log_posterior(held, pose[None])[0], rel=1e-3)
