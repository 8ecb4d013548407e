"""Derivatives by finite differences, to hold the kernel's own against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import retract

Array = NDArray[np.float64]


def tangents(model: BodyModel, pose: Array, value: Callable[[Array], Array]) -> Array:
    """Central finite differences (..., D) of a value (...) by every degree of freedom's step."""
    steps = 1e-5 * np.eye(len(pose))
    ahead, behind = (retract(model, np.tile(pose, (len(pose), 1)), s) for s in (steps, -steps))
    return np.stack([(value(a) - value(b)) / 2e-5 for a, b in zip(ahead, behind, strict=True)], axis=-1)
