"""Gating: whether a pose is accepted, by its normalised residual, the observed points and its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from common.frame import SubjectFrame
from common.settings import SOFT_NOISE_RATIO, RefineSettings
from coordinator.scene.flatness import FLAT_SHARE, find_flat
from coordinator.scene.noise import USUAL_GROWTH
from coordinator.tracking.observation import observed_points

RESIDUAL_M = 0.03  # largest mean distance of observed points, in addition to the camera's noise
MISFIT_M = 0.028  # root of the mean cost, which includes model surface in empty space
LEAST_PIXELS = 150  # smallest number that can show a body
SPAN_SHARES = (0.35, 1.6)  # extent of a person in a frame over stature; else the depth scale is wrong
HEAD_DOWN_M = -0.2  # height of the head above the pelvis
FLOOR_M = (-0.25, 0.6)  # height of the lowest joint above the floor
UNEXPLAINED = "the body does not fit the observed points"


@dataclass(frozen=True, slots=True)
class Gate:
    """The normalised residual of a pose, which passes up to 1. `why` is the main reason against it."""

    residual: float
    why: str = ""

    @property
    def passes(self) -> bool:
        """Whether the pose is accepted."""
        return self.residual <= 1.0

    def against(self, why: str) -> Self:
        """The gate of a pose that is ruled out for another reason; unchanged if `why` is empty."""
        return type(self)(np.inf, self.why or why) if why else self


def gate_pose(log_likelihood: float, residual: float, settings: RefineSettings) -> Gate:
    """The gate of a pose with this log likelihood and mean residual (metres), at the camera's noise."""
    misfit = 0.0
    if settings.noise_depth <= SOFT_NOISE_RATIO * settings.noise_lateral:
        cost = np.sqrt(max(0.0, -2.0 * log_likelihood)) * settings.likelihood_scale
        misfit = float(cost / np.hypot(MISFIT_M, settings.noise_lateral))
    normalised = max(float(residual) / (RESIDUAL_M + settings.noise_depth), misfit)
    if not normalised <= 1.0:
        return Gate(normalised if normalised > 1.0 else np.inf, UNEXPLAINED)
    return Gate(normalised)


def reject_points(subject: SubjectFrame, stature: float) -> str:
    """Why a subject cannot be a person of this stature; empty if it can."""
    low, high = np.percentile(observed_points(subject), [1.0, 99.0], axis=0)
    span = float(np.max(high - low))
    if not SPAN_SHARES[0] * stature <= span <= SPAN_SHARES[1] * stature:
        size = f"{span:.1f} m" if span >= 1.0 else f"{100 * span:.0f} cm"
        return f"the observed points extend over {size}, which is not a person: is depth_scale right?"
    depth = subject.frame.metres()
    flat = find_flat(depth, depth > 0.0, subject.frame.intrinsics, USUAL_GROWTH).share
    return (
        f"{100 * flat:.0f} % of the observed points lie in one plane: an object, not a person"
        if flat > FLAT_SHARE
        else ""
    )


def reject_position(rises: float, lowest: float) -> str:
    """Why a body cannot be at its place; empty if it can.

    Args:
        rises: Height of the head above the pelvis, metres.
        lowest: Height of the lowest joint above the floor, metres.
    """
    if rises < HEAD_DOWN_M:
        return "the body is upside down; if the camera is, use --rotate"
    if lowest < FLOOR_M[0]:
        return f"the body reaches {-100 * lowest:.0f} cm below the floor"
    if lowest > FLOOR_M[1]:
        return f"the body floats {100 * lowest:.0f} cm above the floor"
    return ""
