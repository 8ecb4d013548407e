"""Cameras of recordings: as their file says, as the user says, and without their lens' distortion."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from common.camera import Intrinsics
from common.errors import InputError

DEFAULT_FPS = 30.0
MILLIMETRES = 1000.0  # units per metre
Array = NDArray[np.float64]

NOMINAL = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
"""A camera of the kind of the first Kinect, where nothing says which one it was."""

Positive = Annotated[float, Meta(gt=0)]
Size = Annotated[int, Meta(ge=1, le=32_768)]


class CameraFile(msgspec.Struct):
    """`camera_intrinsic.json`; keys that other programs add are passed over."""

    width: Size
    height: Size
    intrinsic_matrix: Annotated[list[float], Meta(min_length=9, max_length=9)]  # column by column
    depth_scale: Positive
    fps: Positive = DEFAULT_FPS


def read_camera(path: Path) -> tuple[Intrinsics, float, float]:
    """Intrinsics, units of depth per metre and frames per second of a camera file; InputError if damaged."""
    try:
        content = json.loads(path.read_bytes(), parse_constant=_refuse_constant)
        camera = msgspec.convert(content, CameraFile)
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing; add --intrinsics fx,fy,cx,cy (pixels), or write it with width, height, "
            "intrinsic_matrix (9 numbers, column by column) and depth_scale (units per metre)"
        ) from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; mend its permissions") from error
    except (ValueError, RecursionError) as error:  # of json, of msgspec, of the text's encoding
        raise InputError(f"{path}: {error}; mend that entry") from error
    matrix = np.reshape(camera.intrinsic_matrix, (3, 3)).T
    intrinsics = pinhole(matrix, camera.width, camera.height, f"{path}, read column by column")
    if not np.isfinite([camera.depth_scale, camera.fps]).all():
        raise InputError(f"{path}: depth_scale or fps is not finite; mend that entry")
    return intrinsics, camera.depth_scale, camera.fps


def pinhole(matrix: ArrayLike, width: int, height: int, name: str) -> Intrinsics:
    """Intrinsics from a matrix (3, 3); InputError unless it is one of a pinhole camera without skew."""
    values = np.asarray(matrix)
    if values.shape != (3, 3) or values.dtype.kind not in "iuf" or min(width, height) < 1:
        raise InputError(f"{name}: intrinsics are not a 3 x 3 matrix; give fx 0 cx, 0 fy cy, 0 0 1")
    (fx, _, cx), (_, fy, cy), _ = values.astype(np.float64).tolist()
    good = values.tolist() == [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] and min(fx, fy) > 0
    if not (good and np.isfinite([fx, fy, cx, cy]).all()):
        raise InputError(
            f"{name}: intrinsics are not fx 0 cx, 0 fy cy, 0 0 1 with positive fx, fy; mend them"
        )
    return Intrinsics(width, height, fx, fy, cx, cy)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number that a camera can have")


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """The user's intrinsics fx, fy, cx, cy, pixels, and units per metre; None for what the recording says."""

    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None

    def matrix(self, name: str) -> list[list[float]]:
        """The camera's matrix (3, 3); InputError where the user gives none for the recording of this name."""
        if self.intrinsics is None:
            raise InputError(
                f"{name} does not say its camera; add --intrinsics fx,fy,cx,cy (pixels), or write "
                "camera_intrinsic.json beside the frames"
            )
        fx, fy, cx, cy = self.intrinsics
        return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]

    def camera(self, width: int, height: int, name: str) -> Intrinsics:
        """The camera of images of a size; InputError as for `matrix`."""
        return pinhole(self.matrix(name), width, height, name)


AS_RECORDED = CameraOptions()


def parse_camera_options(intrinsics: str | None, depth_scale: float | None) -> CameraOptions:
    """From the words of the command line; InputError where they make no sense."""
    if depth_scale is not None and not 0.0 < depth_scale < math.inf:
        raise InputError(
            f"--depth-scale {depth_scale:g} is no number of units per metre; millimetres have 1000"
        )
    if intrinsics is None:
        return CameraOptions(None, depth_scale)
    try:
        fx, fy, cx, cy = (float(part) for part in intrinsics.split(","))
    except ValueError:
        raise InputError(
            f"--intrinsics '{intrinsics}' is not fx,fy,cx,cy in pixels; give four numbers"
        ) from None
    if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 0.0 and fy > 0.0):
        raise InputError(f"--intrinsics '{intrinsics}' is not fx,fy,cx,cy with positive fx, fy; mend it")
    return CameraOptions((fx, fy, cx, cy), depth_scale)


@dataclass(frozen=True, slots=True)
class Distortion:
    """Radial terms k1 to k6, and tangential p1, p2; `reach` is the largest radius that they are made for."""

    radial: tuple[float, float, float, float, float, float]
    tangential: tuple[float, float]
    reach: float = np.inf

    def distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where the lens shows what a pinhole camera sees at (x, y) on the plane z = 1; NaN out of reach."""
        k1, k2, k3, k4, k5, k6 = self.radial
        p1, p2 = self.tangential
        r2 = x * x + y * y
        above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        scale = np.where(r2 <= self.reach**2, above / below, np.nan)
        return (
            x * scale + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * scale + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )


class Undistortion:
    """The pixels of a lens that belong to each pixel of the pinhole camera with the same matrix."""

    def __init__(self, camera: Intrinsics, distortion: Distortion) -> None:
        v, u = np.indices((camera.height, camera.width), dtype=np.float64)
        x, y = distortion.distort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
        columns, rows = np.rint(x * camera.fx + camera.cx), np.rint(y * camera.fy + camera.cy)
        self._seen = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        self._from = np.where(self._seen, rows * camera.width + columns, 0.0).astype(np.int64)

    def __call__(self, depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """A depth image (H, W); 0 where the lens saw nothing."""
        return np.where(self._seen, depth.ravel()[self._from], 0).astype(np.uint16)


NEAREST_IN_A_ROOM_M, FARTHEST_IN_A_ROOM_M = 0.4, 10.0
"""All depth below or beyond of this is not that of a camera in a room."""

SCALE = "is it in other units? --depth-scale N says how many are a metre"


def doubt_range(near: float | None, far: float | None) -> str | None:
    """What is odd about the nearest and farthest depth, metres; None where nothing is."""
    if near is None or far is None:
        return f"no depth is there in the frames that were looked at (floats count up to 6.5 m); {SCALE}"
    if near > FARTHEST_IN_A_ROOM_M or far < NEAREST_IN_A_ROOM_M:
        return f"all depth lies between {near:.3g} and {far:.3g} m; {SCALE}"
    return None


def doubt_camera(camera: Intrinsics) -> str | None:
    """What is odd about a camera's matrix; None where nothing is."""
    if 0.0 <= camera.cx <= camera.width and 0.0 <= camera.cy <= camera.height:
        return None
    return (
        f"the camera's centre ({camera.cx:g}, {camera.cy:g}) is outside of its picture of "
        f"{camera.width}x{camera.height}; are these the intrinsics of another size?"
    )
