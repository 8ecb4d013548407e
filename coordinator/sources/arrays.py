"""Depth in numpy arrays: in memory, or as an `.npz` or `.npy` file."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gepf.common.errors import InputError
from gepf.coordinator.files import read_arrays
from gepf.coordinator.sources.camera import DEFAULT_FPS, MILLIMETRES, GivenCamera, intrinsics_of
from gepf.coordinator.sources.source import FARTHEST_M, Source

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
        scale = choose_scale(array, depth_scale, name)
        if not isinstance(array, np.memmap):
            check_values(array, name)
        camera = intrinsics_of(matrix, array.shape[2], array.shape[1], name)
        super().__init__(name, camera, range(len(array)), array.__getitem__, scale, fps)


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
    """Read an `.npy` file of depth (F, H, W), whose camera the user gives; integers are millimetres.

    Frames are read when they are needed, each with its own map of the file, so that no other stays in memory.
    """
    depth = map_file(path)
    scale = given.depth_scale or (MILLIMETRES if depth.dtype.kind in "iu" else None)
    source = ArraySource(depth, given.matrix(path), scale, name=path.stem)

    def read(place: int) -> NDArray[np.generic]:
        frame = np.array(map_file(path)[place])
        check_values(frame, f"{path}: frame {place}")
        return frame

    return source.changed(read=read)


def map_file(path: Path) -> NDArray[np.generic]:
    """The array of an `.npy` file, of which only what is used is read."""
    try:
        array: NDArray[np.generic] = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path} is damaged or not an array of numbers ({error}); save it again") from error
    return array


def choose_scale(array: NDArray[np.generic], depth_scale: float | None, name: str) -> float:
    """Units of depth (F, H, W) per metre.

    Floats are metres; if more than half of them would be too far away in some frames, they are millimetres.
    """
    if depth_scale is not None and not 0 < depth_scale < np.inf:
        raise InputError(f"{name}: depth_scale is {depth_scale}; give the units of depth per metre")
    if array.dtype.kind == "f" and depth_scale is None:
        some = np.unique(np.linspace(0, len(array) - 1, 10).astype(int))  # ten frames
        middle = median_depth(np.array([array[n][::4, ::4] for n in some], dtype=np.float64))
        if middle > FARTHEST_M:
            logger.warning("%s: depth (median %.0f) is interpreted as millimetres", name, middle)
        return MILLIMETRES if middle > FARTHEST_M else 1.0
    if depth_scale is None:
        raise InputError(f"{name}: depth of type {array.dtype} has no unit; add depth_scale, units per metre")
    return float(depth_scale)


def check_values(array: NDArray[np.generic], name: str) -> None:
    """InputError if depth is neither floats nor whole numbers of 16 bits."""
    if array.dtype.kind == "f":
        return
    kept = array.dtype.kind in "iu" and array.min() >= 0 and array.max() <= np.iinfo(np.uint16).max
    if not kept:
        raise InputError(f"{name}: depth must be metres as floats or whole units from 0 to 65535; convert it")


def median_depth(depth: NDArray[np.floating]) -> float:
    """The median of measured depth, in its own units; 0 without any."""
    seen = depth[np.isfinite(depth) & (depth > 0.0)]
    return float(np.median(seen)) if len(seen) else 0.0
