"""Settings in the units of the compiled kernel."""

from __future__ import annotations

from typing import NamedTuple

from common.settings import Descent, RefineSettings

OUTLIER_DISTANCE_M = 0.1  # residuals beyond it lose influence


class Steps(NamedTuple):
    """How an iteration of ICP moves."""

    gauss_newton_iterations: int
    over_relaxed: bool  # whether every iteration but the last goes twice as far
    visibility_interval: int  # iterations from one visibility update to the next
    damping_share: float  # of lambda of Eq. 4, that each observed point adds to it


STEPS: dict[Descent, Steps] = {
    "plain": Steps(5, False, 1, 0.0),
    "accelerated": Steps(2, True, 3, 0.0003),
}


class KernelParameters(NamedTuple):
    """Settings in the kernel's own units."""

    icp_iterations: int
    steps: Steps
    soft: bool
    free_space: bool  # whether model points seen where nothing was observed count
    damping: float
    rest_weight: float  # m^2, of a squared joint angle, for each point
    stretch: float  # lateral over depth noise
    outlier_squared: float  # m^2; 0 gives all points full weight
    posterior_scale: float  # 1/m^2: from the mean cost of a point to twice the log posterior
    independent_points: float
    noise_depth: float  # metres
    noise_lateral: float


def rest_weight(settings: RefineSettings) -> float:
    """Of a squared joint angle, for each point (m^2): in the likelihood it has the deviation of the prior.

    Under noise that asks for soft correspondences there is none: the arm alone was measured there.
    """
    if settings.is_soft or not settings.pose_deviation > 0.0:
        return 0.0
    ratio = settings.likelihood_scale / settings.pose_deviation
    return ratio * ratio


def pack_parameters(settings: RefineSettings) -> KernelParameters:
    """Pack settings in the kernel's own units."""
    soft, camera, points = settings.is_soft, settings.sensor == "camera", settings.independent_points
    return KernelParameters(
        settings.icp_iterations,
        STEPS[settings.descent],
        soft,
        camera,
        settings.damping,
        rest_weight(settings),
        settings.noise_lateral / settings.noise_depth,
        OUTLIER_DISTANCE_M**2 if camera else 0.0,
        points / settings.noise_lateral**2 if soft else 1.0 / settings.likelihood_scale**2,
        points,
        settings.noise_depth,
        settings.noise_lateral,
    )
