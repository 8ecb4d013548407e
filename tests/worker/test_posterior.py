"""One log posterior: what the descent goes down is what the weight is, prior included.

On the plain path, whose equations and likelihood the kernel's are held against elsewhere.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import retract
from common.settings import RefineSettings
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import DEFAULT, SETTINGS, TRUTH, subject
from worker.kernel.job import refine
from worker.kernel.observation import observe
from worker.kernel.solver.priors import LIMIT_SHARE

Array = NDArray[np.float64]

POSES = 20
STEP = 1e-6  # radians and metres
EXACT = {False: 1e-4, True: 5e-3}  # relative; a blended vertex is taken to be carried whole by its links
SMOOTH = 0.9  # of the poses: where a vertex comes to another pixel, the silhouette's cost leaps


def score(model: BodyModel, pose: Array, visible: NDArray[np.int64], settings: RefineSettings) -> float:
    """The log posterior of a pose (D,), of what was visible."""
    frozen = msgspec.structs.replace(settings, descent="accelerated")
    return plain_path.evaluate(model, pose, visible, subject(), frozen)[0]


def slope(model: BodyModel, pose: Array, visible: NDArray[np.int64], settings: RefineSettings) -> Array:
    """Minus what the descent's equations have on their right side (D,), as a slope of the log posterior."""
    count = len(subject().picked)
    posed = plain_path.visible_vertices(model, pose)[0]
    factors = plain_path.weigh_correspondences(model, pose, posed, visible, subject(), settings)
    gram, gradient = plain_path.equations(model, factors, pose, settings)
    stiffness = plain_path.rest_weight(settings) * count
    gram, gradient = plain_path.add_rest_prior(model, pose, stiffness, gram, gradient)
    gram, gradient = plain_path.add_limit_prior(model, pose, LIMIT_SHARE * count, gram, gradient)
    return -gradient / (count * settings.likelihood_scale**2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "blended"), [("default", False), ("camera, plain and rest", False), ("default", True)]
)
def test_what_is_descended_is_the_slope_of_what_is_weighed(name: str, blended: bool) -> None:
    """Finite differences of the log posterior in a random direction, at poses near and far, to 1e-4."""
    model, settings, rng = puppet(blended=blended), SETTINGS[name], np.random.default_rng(0)
    spread = np.where(model.kinds == ROTATION, 0.3, 0.03)
    exact = []
    for _ in range(POSES):
        pose, direction = TRUTH + spread * rng.normal(size=len(TRUTH)), rng.normal(size=len(TRUTH))
        visible = plain_path.visible_vertices(model, pose)[1]
        ahead, behind = (
            score(model, retract(model, pose[None], s * STEP * direction[None])[0], visible, settings)
            for s in (1.0, -1.0)
        )
        measured = (ahead - behind) / (2.0 * STEP)
        gradient = slope(model, pose, visible, settings)
        exact.append(abs(measured - gradient @ direction) <= EXACT[blended] * np.linalg.norm(gradient))
    assert np.mean(exact) >= SMOOTH


def test_every_weight_is_the_posterior_of_the_pose_that_comes_with_it() -> None:
    """A refined pose, only assessed, has the log posterior that it was returned with."""
    model, settings = puppet(), msgspec.structs.replace(DEFAULT, descent="plain")
    poses = TRUTH + 0.1 * np.random.default_rng(2).normal(size=(12, len(TRUTH)))
    observation = observe(subject())
    refined = refine(model, observation, poses, settings)
    again = refine(model, observation, refined.poses, msgspec.structs.replace(settings, icp_iterations=0))
    np.testing.assert_allclose(again.log_likelihood, refined.log_likelihood, rtol=1e-6)


def test_far_from_rest_is_less_likely() -> None:
    """Of two poses that explain a frame alike, the one nearer to rest weighs more, by what the prior says."""
    model, near, far = puppet(), np.zeros(19), np.zeros(19)
    far[model.dof("head_nod")] = 0.5
    settings = msgspec.structs.replace(DEFAULT, pose_deviation=0.8)
    costs = [plain_path.prior_cost(model, pose, settings) for pose in (near, far)]
    nats = -0.5 * np.diff(costs)[0] / settings.likelihood_scale**2
    assert nats == pytest.approx(-0.5 * (0.5 / 0.8) ** 2)
