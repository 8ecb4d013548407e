"""Settings in the units of the compiled kernel."""

from __future__ import annotations

import math
from typing import NamedTuple

from gepf.common.refinement import KEYPOINT_WEIGHT
from gepf.common.settings import Descent, RefineSettings

OUTLIER_DISTANCE_M = 0.1  # scale of the robust kernel
LIMIT_WEIGHT_M2 = 0.002  # of a squared radian outside the limits of a spherical joint
LONGEST_STEP = 0.2  # of scoring, radians and metres; its damping is a prior on the step, as wide as this


class Steps(NamedTuple):
    """Settings of an iteration of ICP."""

    gauss_newton_iterations: int
    over_relaxed: bool  # whether every iteration but the last moves twice as far
    visibility_interval: int  # iterations between visibility tests
    damping_share: float  # added to lambda of Eq. 4 for each observed point
    settled: float  # radians and metres; ICP ends after an iteration that moves less, before doubling


STEPS: dict[Descent, Steps] = {
    "plain": Steps(5, False, 1, 0.0, 0.0),
    "accelerated": Steps(2, True, 3, 0.0003, 0.005),
}


class Weights(NamedTuple):
    """Weights of the terms of points, in nats; a term with the weight 0 is left out."""

    depth: float  # of half a squared metre, per observed point
    free_space: float  # of half a squared metre, per observed point
    soft: float  # of the log density of a point
    keypoints: float  # of half a squared deviation of a keypoint


class Solver(NamedTuple):
    """Damped Gauss-Newton at fixed correspondences."""

    iterations: int
    damping: float  # nats per half a squared radian or metre of a step
    longest: float  # largest entry of a step, radians and metres


class KernelParameters(NamedTuple):
    """Settings in the units of the kernel."""

    icp_iterations: int
    scoring_iterations: int  # after them
    steps: Steps
    icp: Solver
    scoring: Solver
    closest: Weights  # in ICP, with closest points
    posterior: Weights  # in the log posterior and in scoring
    limit_stiffness: float  # nats per squared radian
    stretch: float  # ratio of lateral to depth noise
    per_outlier_squared: float  # 1 / m^2, of the robust kernel; 0 gives all points full weight
    noise_depth: float  # metres
    noise_lateral: float
    outside_weight: float  # of a squared distance from the plane of the surface, for a point outside of it


def pack_parameters(settings: RefineSettings, points: int) -> KernelParameters:
    """Convert settings to the units of the kernel, for this number of observed points.

    A squared metre, averaged over the points, has the same weight in ICP as in the log posterior.
    """
    soft, camera, steps = settings.is_soft, settings.sensor == "camera", STEPS[settings.descent]
    independent, scale = settings.independent_points, settings.likelihood_scale
    of_mean = independent / settings.noise_lateral**2 if soft else 1.0 / scale**2  # nats per squared metre
    count = max(1, points)
    of_point = of_mean / count
    damping = (settings.damping + steps.damping_share * points) * of_point
    closest = Weights(of_point, of_point if camera else 0.0, 0.0, KEYPOINT_WEIGHT)
    return KernelParameters(
        settings.icp_iterations,
        settings.icp_iterations if soft else 0,
        steps,
        Solver(steps.gauss_newton_iterations, damping, math.inf),
        Solver(1, independent / count / LONGEST_STEP**2, LONGEST_STEP),
        closest,
        Weights(0.0, 0.0, independent / count, KEYPOINT_WEIGHT) if soft else closest,
        LIMIT_WEIGHT_M2 * of_mean,
        settings.stretch,
        OUTLIER_DISTANCE_M**-2 if camera else 0.0,
        settings.noise_depth,
        settings.noise_lateral,
        settings.outside_weight if camera else 1.0,
    )
