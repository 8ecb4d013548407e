"""One log posterior: the descent maximises the same value that is the weight, with all terms.

The kernel's equations and weights are compared with `tests/support/kernel/posterior.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.refinement import Particles
from gepf.coordinator.filters.priors import pose_prior
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import observe
from tests.support.kernel.equations import KernelAt
from tests.support.kernel.posterior import (
    BODIES,
    SETTINGS,
    log_posterior,
    posterior_case,
    random_poses,
    slope,
)

MANY, FEW = 200, 6


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
        kernel = KernelAt.make(of, pose)
        exact = slope(kernel.held(), pose)
        assert np.linalg.norm(-kernel.linearise()[1] - exact) < 1e-4 * np.linalg.norm(exact)
    prior = pose_prior(of.model, of.settings)
    refined = refine(of.model, observe(of.subject), Particles(poses, of.settings, prior=prior))
    for pose, weight in zip(refined.poses, refined.log_likelihood, strict=True):
        held = KernelAt.make(of, pose).held()
        assert weight == pytest.approx(log_posterior(held, pose[None])[0], rel=1e-3)
