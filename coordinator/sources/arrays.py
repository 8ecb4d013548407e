"""Depth in numpy arrays: in memory when used as a library, or as an `.npz` file."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files import read_arrays
from coordinator.sources.camera import AS_RECORDED, DEFAULT_FPS, MILLIMETRES, CameraOptions, pinhole
from coordinator.sources.source import Recording

logger = logging.getLogger(__name__)

FARTHEST_M = 40.0
UNITS_PER_METRE = 5000.0  # that metres are turned into: steps of 0.2 mm, up to 13 m


class ArraySource(Recording):
    """Frames of an array.

    Args:
        depth: (F, H, W), either whole numbers in units of `depth_scale`, or metres; 0 or NaN where nothing
            was measured.
        matrix: The camera's (3, 3): fx 0 cx, 0 fy cy, 0 0 1, in pixels.
        depth_scale: Units per metre; needed for whole numbers only.
        fps: Frames per second.
        name: What the sequence is called.

    Raises InputError where shapes or numbers make no sense.
    """

    def __init__(
        self,
        depth: ArrayLike,
        matrix: ArrayLike,
        depth_scale: float | None = None,
        fps: float = DEFAULT_FPS,
        name: str = "arrays",
    ) -> None:
        self.name, self.fps = name, fps
        array = np.asarray(depth)
        if array.ndim != 3 or 0 in array.shape:
            raise InputError(
                f"{name}: depth has shape {array.shape}; give frames of rows of columns (F, H, W)"
            )
        if not 0 < fps < np.inf:
            raise InputError(f"{name}: {fps} frames a second make no sense; give a positive number")
        self._depth, self._scale = whole_depth(array, depth_scale, name)
        self.intrinsics = pinhole(matrix, array.shape[2], array.shape[1], name)
        self.numbers = range(len(array))

    def frame(self, number: int) -> DepthFrame:
        """One frame."""
        return DepthFrame(number, number / self.fps, self._depth[number], self._scale, self.intrinsics)


def read_array_source(path: Path, options: CameraOptions = AS_RECORDED) -> ArraySource:
    """An `.npz` file: `depth`, `intrinsics` (3, 3), for whole numbers `depth_scale`; optional `fps`."""
    arrays = read_arrays(path)
    scale, fps = (float(arrays.floats(key, ())) if key in arrays else None for key in ("depth_scale", "fps"))
    own = options.intrinsics is None
    matrix = arrays.floats("intrinsics", (3, 3)) if own else options.matrix(path.stem)
    return ArraySource(
        arrays.any("depth"), matrix, options.depth_scale or scale, fps or DEFAULT_FPS, path.stem
    )


def read_array(path: Path, options: CameraOptions) -> ArraySource:
    """An `.npy` file of depth (F, H, W); the camera has to be options, whole numbers are millimetres."""
    try:
        depth = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is damaged or no array of numbers ({error}); save it again") from error
    scale = options.depth_scale or (MILLIMETRES if depth.dtype.kind in "iu" else None)
    return ArraySource(depth, options.matrix(str(path)), scale, name=path.stem)


def whole_depth(
    array: NDArray[np.generic], depth_scale: float | None, name: str
) -> tuple[NDArray[np.uint16], float]:
    """Depth (F, H, W) in whole units, and units per metre; floats that must be millimetres are taken so."""
    if array.dtype.kind == "f":
        values = array.astype(np.float64)
        return to_units(values / (depth_scale or units_of_floats(values, name))), UNITS_PER_METRE
    if array.dtype.kind not in "iu" or array.min() < 0 or array.max() > np.iinfo(np.uint16).max:
        raise InputError(f"{name}: depth is not metres as float, nor whole units from 0 to 65535; convert it")
    if depth_scale is None or not 0 < depth_scale < np.inf:
        raise InputError(f"{name}: depth in {array.dtype} needs depth_scale, its units per metre; add it")
    return array.astype(np.uint16), float(depth_scale)


def units_of_floats(values: NDArray[np.float64], name: str) -> float:
    """1 for metres, 1000 where half of the depth would be farther than any depth camera sees."""
    seen = values[np.isfinite(values) & (values > 0.0)]
    if not len(seen) or np.median(seen) < FARTHEST_M:
        return 1.0
    logger.warning("%s: depth of %.0f and more is taken as millimetres", name, np.median(seen))
    return MILLIMETRES


def to_units(metres: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Metres in whole units; 0 where nothing was measured or it is too far."""
    units = np.rint(np.nan_to_num(metres, nan=0.0, posinf=0.0, neginf=0.0) * UNITS_PER_METRE)
    return np.where((units > 0) & (units <= np.iinfo(np.uint16).max), units, 0).astype(np.uint16)
