"""Pictures that end at the knees or above them: what is outside is hidden, and its reference is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.frame import DepthFrame

Array = NDArray[np.float64]


def row_between(joints: Array, names: tuple[str, ...], share: float, camera: Intrinsics) -> int:
    """The row at a share of the way from knees to hips, by joints (T, J, 3), NaN where there are none."""
    knees, hips = (
        np.nanmean([joints[:, names.index(f"{side}_{part}")] for side in ("left", "right")], axis=(0, 1))
        for part in ("knee", "hip")
    )
    _, y, z = knees + share * (hips - knees)
    return int(np.clip(round(camera.cy + camera.fy * y / z), 1, camera.height))


def cut_below(frame: DepthFrame, row: int) -> DepthFrame:
    """What a camera sees whose picture ends at a row."""
    camera = frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    depth = np.ascontiguousarray(frame.depth[:row])
    return replace(frame, depth=depth, intrinsics=Intrinsics(camera.width, row, *lens))
