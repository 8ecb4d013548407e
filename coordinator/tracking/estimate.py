"""What the tracker says about one frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.certainty.certainty import Certainty

Status = Literal["tracked", "ambiguous", "lost", "searching", "absent"]

UNKNOWN = ("lost", "searching", "absent")
"""Status of frames whose pose is not to be believed: the last that was known, the best guess where the
body is looked for, or not a number if there was none yet."""

RECORDED = 100  # hypotheses of an estimate at the most, the likeliest


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The reported pose of a frame, all hypotheses (M) behind it, and how sure the tracker is.

    Weights sum to 1. Joint positions are in the camera frame, metres. `residual` is the likeliest's
    mean distance between observed points and the model, metres; NaN where nothing was observed. Until the
    body is found there are no hypotheses (M = 0), and pose and joints are NaN.
    `particles_answered` are those whose descent was finished when the frame was due. `why` is what speaks
    against the pose, in words; empty where nothing does. `certainty` is how sure each joint is; None in an
    estimate that no tracker made.
    """

    frame: int
    time_s: float
    status: Status
    pose: NDArray[np.float64]  # (D,)
    joint_positions: NDArray[np.float64]  # (J, 3)
    hypothesis_pose: NDArray[np.float64]  # (M, D)
    hypothesis_weight: NDArray[np.float64]  # (M,)
    residual: float
    stage_seconds: dict[str, float] = field(default_factory=dict)
    particles_answered: int = 0
    why: str = ""
    certainty: Certainty | None = None
