"""Settings in the units of the compiled kernel."""

from __future__ import annotations

from typing import NamedTuple

from gepf.common.settings import Descent, RefineSettings

OUTLIER_DISTANCE_M = 0.1  # scale of the robust kernel


class Steps(NamedTuple):
    """Settings of an iteration of ICP."""

    gauss_newton_iterations: int
    over_relaxed: bool  # whether every iteration but the last moves twice as far
    visibility_interval: int  # iterations between visibility tests
    damping_share: float  # of lambda of Eq. 4, per observed point
    settled: float  # radians and metres; ICP ends after an iteration that moves less, before doubling


STEPS: dict[Descent, Steps] = {
    "plain": Steps(5, False, 1, 0.0, 0.0),
    "accelerated": Steps(2, True, 3, 0.0003, 0.005),
}


class KernelParameters(NamedTuple):
    """Settings in the units of the kernel."""

    icp_iterations: int
    steps: Steps
    soft: bool
    free_space: bool  # whether model points in free space have residuals
    damping: float
    rest_weight: float  # m^2, of a squared joint angle, per point
    stretch: float  # ratio of lateral to depth noise
    outlier_squared: float  # m^2; 0 gives all points full weight
    posterior_scale: float  # 1/m^2: from the mean cost of a point to twice the log posterior
    independent_points: float
    noise_depth: float  # metres
    noise_lateral: float


def rest_weight(settings: RefineSettings) -> float:
    """Weight (m^2 per point) of a squared joint angle in the Gaussian prior around the rest pose.

    It is zero with soft correspondences, with which the prior was not measured.
    """
    if settings.is_soft or not settings.pose_deviation > 0.0:
        return 0.0
    ratio = settings.likelihood_scale / settings.pose_deviation
    return ratio * ratio


def pack_parameters(settings: RefineSettings) -> KernelParameters:
    """Convert settings to the units of the kernel."""
    soft, camera, points = settings.is_soft, settings.sensor == "camera", settings.independent_points
    return KernelParameters(
        settings.icp_iterations,
        STEPS[settings.descent],
        soft,
        camera,
        settings.damping,
        rest_weight(settings),
        settings.stretch,
        OUTLIER_DISTANCE_M**2 if camera else 0.0,
        points / settings.noise_lateral**2 if soft else 1.0 / settings.likelihood_scale**2,
        points,
        settings.noise_depth,
        settings.noise_lateral,
    )
