"""Depth in numpy arrays: in memory, or as an `.npz` or `.npy` file."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gepf.common.errors import InputError
from gepf.coordinator.files import read_arrays
from gepf.coordinator.sources.camera import DEFAULT_FPS, MILLIMETRES, GivenCamera, intrinsics_of
from gepf.coordinator.sources.source import FARTHEST_M, UNITS_PER_METRE, Source, to_units

logger = logging.getLogger(__name__)


class ArraySource(Source):
    """Frames of an array.

    Args:
        depth: (F, H, W), integers in units of `depth_scale`, or metres as floats; 0 or NaN for no depth.
        matrix: Camera matrix (3, 3): fx 0 cx, 0 fy cy, 0 0 1, in pixels.
        depth_scale: Units per metre; needed only for integers.
        fps: Frames per second.
        name: Name of the sequence.

    Raises InputError for invalid shapes or numbers.
    """

    def __init__(
        self,
        depth: ArrayLike,
        matrix: ArrayLike,
        depth_scale: float | None = None,
        fps: float = DEFAULT_FPS,
        name: str = "arrays",
    ) -> None:
        array = np.asarray(depth)
        if array.ndim != 3 or 0 in array.shape:
            raise InputError(f"{name}: depth has shape {array.shape}; give frames (F, H, W)")
        if not 0 < fps < np.inf:
            raise InputError(f"{name}: {fps} frames a second is not valid; give a positive number")
        units, scale = whole_depth(array, depth_scale, name)
        camera = intrinsics_of(matrix, array.shape[2], array.shape[1], name)
        super().__init__(name, camera, range(len(units)), units.__getitem__, scale, fps)


def read_npz(path: Path, given: GivenCamera) -> Source:
    """Read an `.npz` file: `depth`, `intrinsics` (3, 3), for integers `depth_scale`; optional `fps`."""
    layout = {"depth": "raw numbers (F, H, W)", "depth_scale": "?numbers", "fps": "?numbers"}
    if given.intrinsics is None:
        layout["intrinsics"] = "numbers (3, 3)"
    arrays = read_arrays(path, layout)
    matrix = given.matrix(path) if given.intrinsics else arrays["intrinsics"]
    scale = given.depth_scale or (float(arrays["depth_scale"]) if "depth_scale" in arrays else None)
    return ArraySource(arrays["depth"], matrix, scale, float(arrays.get("fps", DEFAULT_FPS)), path.stem)


def read_npy(path: Path, given: GivenCamera) -> Source:
    """Read an `.npy` file of depth (F, H, W), whose camera the user gives; integers are millimetres."""
    try:
        depth = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is damaged or not an array of numbers ({error}); save it again") from error
    scale = given.depth_scale or (MILLIMETRES if depth.dtype.kind in "iu" else None)
    return ArraySource(depth, given.matrix(path), scale, name=path.stem)


def whole_depth(
    array: NDArray[np.generic], depth_scale: float | None, name: str
) -> tuple[NDArray[np.uint16], float]:
    """Depth as integers, and units per metre.

    Floats are metres; if more than half of them would be too far away, they are millimetres.
    """
    if array.dtype.kind == "f":
        values = array.astype(np.float64)
        if depth_scale is None:
            middle = median_depth(values)
            depth_scale = MILLIMETRES if middle > FARTHEST_M else 1.0
            if middle > FARTHEST_M:
                logger.warning("%s: depth (median %.0f) is interpreted as millimetres", name, middle)
        return to_units(values / depth_scale), UNITS_PER_METRE
    if array.dtype.kind not in "iu" or array.min() < 0 or array.max() > np.iinfo(np.uint16).max:
        raise InputError(f"{name}: depth must be metres as floats or whole units from 0 to 65535; convert it")
    if depth_scale is None or not 0 < depth_scale < np.inf:
        raise InputError(f"{name}: depth in {array.dtype} needs depth_scale, its units per metre; add it")
    return array.astype(np.uint16), float(depth_scale)


def median_depth(depth: NDArray[np.floating]) -> float:
    """The median of measured depth, in its own units; 0 without any."""
    seen = depth[np.isfinite(depth) & (depth > 0.0)]
    return float(np.median(seen)) if len(seen) else 0.0
