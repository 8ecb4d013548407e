"""Depth in numpy arrays: in memory for who uses this as a library, or as an `.npz` file."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files import ArrayFile, read_arrays
from coordinator.sources.camera import AS_RECORDED, DEFAULT_FPS, MILLIMETRES, CameraOptions
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
        self.intrinsics = camera_of(np.asarray(matrix), array.shape[2], array.shape[1], name)
        self.numbers = range(len(array))

    def frame(self, number: int) -> DepthFrame:
        """One frame."""
        return DepthFrame(number, number / self.fps, self._depth[number], self._scale, self.intrinsics)


def read_array_source(path: Path, given: CameraOptions = AS_RECORDED) -> ArraySource:
    """An `.npz` file: `depth`, `intrinsics` (3, 3), for whole numbers `depth_scale`; optional `fps`."""
    arrays = read_arrays(path)
    scale = number_in(arrays, "depth_scale") if "depth_scale" in arrays else None
    fps = number_in(arrays, "fps") if "fps" in arrays else DEFAULT_FPS
    matrix = matrix_of(given) if given.intrinsics is not None else arrays.floats("intrinsics", (3, 3))
    return ArraySource(arrays.any("depth"), matrix, given.depth_scale or scale, fps, path.stem)


def read_array(path: Path, given: CameraOptions) -> ArraySource:
    """An `.npy` file of depth (F, H, W); the camera has to be given, whole numbers are millimetres."""
    try:
        depth = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is damaged or no array of numbers ({error}); save it again") from error
    given.camera(1, 1, str(path))
    scale = given.depth_scale or (MILLIMETRES if depth.dtype.kind in "iu" else None)
    return ArraySource(depth, matrix_of(given), scale, name=path.stem)


def matrix_of(given: CameraOptions) -> NDArray[np.float64]:
    """The camera's matrix (3, 3) that is given."""
    fx, fy, cx, cy = given.intrinsics or (0.0, 0.0, 0.0, 0.0)
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def number_in(arrays: ArrayFile, key: str) -> float:
    """A single number."""
    return float(arrays.floats(key, ()))


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


def camera_of(matrix: NDArray[np.generic], width: int, height: int, name: str) -> Intrinsics:
    """Intrinsics from a matrix; InputError unless it is one of a pinhole camera without skew."""
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "iuf":
        raise InputError(f"{name}: intrinsics are not a 3 x 3 matrix; give fx 0 cx, 0 fy cy, 0 0 1")
    (fx, _, cx), (_, fy, cy), _ = matrix.astype(np.float64).tolist()
    good = matrix.tolist() == [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] and min(fx, fy) > 0
    if not (good and np.isfinite([fx, fy, cx, cy]).all()):
        raise InputError(
            f"{name}: intrinsics are not fx 0 cx, 0 fy cy, 0 0 1 with positive fx, fy; mend them"
        )
    return Intrinsics(width, height, fx, fy, cx, cy)
