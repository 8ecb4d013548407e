"""The result of tracking one frame."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array

Status = Literal["tracked", "ambiguous", "lost", "searching", "absent"]

Fault = Literal["gives no depth", "repeats an image", "contradicts the others"]
"""Fault of a camera of a rig."""

POSE_UNKNOWN = ("lost", "searching", "absent")
"""The statuses of frames without a valid pose. The pose is then the last known one, a guess while the body is
searched for, or NaN before the first detection."""


_JOINTS_OFF = re.compile(r"may be more than \d+ cm off: ")


def doubtful_joints_text(wrong_m: float, joints: str) -> str:
    """The reason to doubt a pose in which these joints may be wrong."""
    return f"may be more than {100 * wrong_m:.0f} cm off: {joints}"


def single_reasons(why: str) -> list[str]:
    """Split a reason that lists several joints into one reason per joint."""
    listed = _JOINTS_OFF.match(why)
    return [listed[0] + joint for joint in why[listed.end() :].split(", ")] if listed else [why]


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """The certainty of each joint (J,) in a frame; NaN if the pose is unknown."""

    seen: Array  # visible share of the camera-facing surface around it, in the camera that sees it best
    off_probability: Array  # probability of an error above `wrong_m` of the settings, by default 15 cm
    deviation: Array  # one standard deviation of the error of the joint, metres


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The reported pose of a frame, all hypotheses (M), and their certainty.

    Weights sum to 1. Joint positions are in the frame of the camera or rig, metres. `residual` is the mean
    distance between observed points and the most likely hypothesis, metres; NaN if nothing was observed.
    Until the body is detected there are no hypotheses (M = 0), and pose and joints are NaN. `particles` is
    the number of refined particles. `why` is the reason to doubt the pose, as text; empty if there is none.
    `certainty` describes each joint. `seen_by` is the visible share (J,) of the surface around each joint for
    each camera that shows the body. `faults` are the faults of the cameras of a rig, each with its start in
    seconds. `keypoints` (17, 3) are in the colour image of each camera: column, row, inverse variance.
    """

    frame: int
    time_s: float
    status: Status
    pose: Array  #: (D,)
    joint_positions: Array  #: (J, 3)
    hypothesis_pose: Array  #: (M, D)
    hypothesis_weight: Array  #: (M,)
    residual: float
    certainty: Certainty
    stage_seconds: dict[str, float] = field(default_factory=dict)
    particles: int = 0
    why: str = ""
    seen_by: dict[str, Array] = field(default_factory=dict)
    faults: dict[str, tuple[Fault, float]] = field(default_factory=dict)
    keypoints: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
