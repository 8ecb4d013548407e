"""Observation and settings packed for compiled code: plain arrays, fixed dtypes, the kernel's own units."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.bounds import GAUSS_NEWTON_ITERATIONS
from common.settings import Descent, RefineSettings
from worker.kernel.observation import BLOCK, TILE, Observation
from worker.kernel.search.correspondence import boxes_of

KEPT = 2  # packed observations
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
    "plain": Steps(GAUSS_NEWTON_ITERATIONS, 0.0, 1, 0.0),
    "accelerated": Steps(2, 1.0, 3, DAMPING_SHARE),
}


class PackedObservation(NamedTuple):
    """An observation for the kernel, depth stretched so that noise is alike in all directions."""

    points: NDArray[np.float32]  # (3, blocks * BLOCK) metres, z times `stretch`
    blocks: NDArray[np.float32]  # (6, blocks) bounding boxes
    tiles: NDArray[np.float32]  # (6, tiles) and of smaller parts
    count: int  # type: ignore[assignment]  # tuples have a method of that name
    emptiness: NDArray[np.float32]  # (H, W) 0 to 1
    nearest: NDArray[np.int32]  # (2, H, W)
    seen: NDArray[np.int64]  # (4,) left, top, right, bottom of what the camera saw
    fx: float
    fy: float
    cx: float
    cy: float
    stretch: float  # lateral over depth noise


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


def pack_observation(observation: Observation, settings: RefineSettings) -> PackedObservation:
    """Pack an observation in the metric of the noise; those that were asked for last are kept."""
    return stretch(observation, settings.noise_lateral / settings.noise_depth)


@lru_cache(maxsize=KEPT)
def stretch(observation: Observation, ratio: float) -> PackedObservation:
    """Pack an observation, its depths multiplied by a ratio."""
    points = np.ascontiguousarray(observation.points.T)
    points[2] *= np.float32(ratio)
    camera = observation.camera
    return PackedObservation(
        points,
        boxes_of(points, BLOCK),
        boxes_of(points, TILE),
        observation.count,
        observation.emptiness,
        observation.nearest,
        observation.view,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        ratio,
    )


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
