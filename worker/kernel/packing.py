"""Observation and settings packed for compiled code: plain arrays, fixed dtypes, the kernel's own units."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.settings import RefineSettings
from worker.kernel.observation import BLOCK, TILE, Observation
from worker.kernel.search.correspondence import boxes_of

KEPT = 2  # packed observations
HEAVIEST = 1e6  # that a prior may be


class PackedObservation(NamedTuple):
    """An observation for the kernel, depth stretched so that noise is alike in all directions."""

    points: NDArray[np.float32]  # (3, blocks * BLOCK) metres, z times `stretch`
    blocks: NDArray[np.float32]  # (6, blocks) bounding boxes
    tiles: NDArray[np.float32]  # (6, tiles) and of smaller parts
    count: int  # type: ignore[assignment]  # tuples have a method of that name
    occupied: NDArray[np.float32]  # (H, W)
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
    keep_limits: bool
    stretch: float  # lateral over depth noise
    outlier_squared: float  # m^2
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
        observation.occupied,
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
    soft = settings.is_soft
    return KernelParameters(
        settings.icp_iterations,
        soft,
        settings.gauss_newton_iterations,
        settings.over_relaxation,
        settings.visibility_interval,
        settings.damping,
        settings.damping_share,
        rest_weight(settings, soft),
        settings.keep_limits,
        settings.noise_lateral / settings.noise_depth,
        settings.outlier_distance**2,
        settings.free_space_weight,
        1.0 / (settings.likelihood_scale**2),
        settings.independent_points,
        settings.noise_depth,
        settings.noise_lateral,
    )
