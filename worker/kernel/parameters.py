"""Settings in the units of the compiled kernel."""

from __future__ import annotations

import math
from typing import NamedTuple

from common.settings import Descent, RefineSettings

OUTLIER_DISTANCE = 0.1  # metres: residuals beyond it lose influence
FREE_SPACE_WEIGHT = 1.0  # of model points seen where nothing was observed
DAMPING_SHARE = 0.0003  # of lambda, that each observed point adds to it in an accelerated descent
HEAVIEST = 1e6  # that a prior may be


class Steps(NamedTuple):
    """How an iteration of ICP moves."""

    gauss_newton_iterations: int
    over_relaxation: float  # share of the iteration's motion that is added to it, but to the last one's
    visibility_interval: int  # iterations from one visibility update to the next
    damping_share: float  # added to lambda of Eq. 4 for each observed point


STEPS: dict[Descent, Steps] = {
    "plain": Steps(5, 0.0, 1, 0.0),
    "accelerated": Steps(2, 1.0, 3, DAMPING_SHARE),
}


class KernelParameters(NamedTuple):
    """Settings in the kernel's own units."""

    icp_iterations: int
    soft: bool
    gauss_newton_iterations: int
    over_relaxation: float
    visibility_interval: int
    damping: float
    damping_share: float
    rest_weight: float  # m^2, of a squared joint angle, for each point
    stretch: float  # lateral over depth noise
    outlier_squared: float  # m^2; 0 gives all points full weight
    free_space_weight: float
    likelihood_scale: float  # 1/m^2
    independent_points: float
    noise_depth: float  # metres
    noise_lateral: float


def rest_weight(settings: RefineSettings, soft: bool) -> float:
    """Of a squared joint angle, for each point (m^2): in the likelihood it has the deviation of the prior.

    Under noise that asks for soft correspondences there is none: the arm alone was measured there.
    """
    if soft or not settings.pose_deviation > 0.0:
        return 0.0
    ratio = min(settings.likelihood_scale / settings.pose_deviation, math.sqrt(HEAVIEST))
    return ratio**2


def pack_parameters(settings: RefineSettings) -> KernelParameters:
    """Pack settings in the kernel's own units."""
    soft, steps, camera = settings.is_soft, STEPS[settings.descent], settings.sensor == "camera"
    return KernelParameters(
        settings.icp_iterations,
        soft,
        steps.gauss_newton_iterations,
        steps.over_relaxation,
        steps.visibility_interval,
        settings.damping,
        steps.damping_share,
        rest_weight(settings, soft),
        settings.noise_lateral / settings.noise_depth,
        OUTLIER_DISTANCE**2 if camera else 0.0,
        FREE_SPACE_WEIGHT if camera else 0.0,
        1.0 / (settings.likelihood_scale**2),
        settings.independent_points,
        settings.noise_depth,
        settings.noise_lateral,
    )
