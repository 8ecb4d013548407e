"""Cameras of recordings, from a file or from the user."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from gepf.common.bounds import LARGEST, SMALLEST
from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.files import CAMERA_FILE, read_json, write_json

DEFAULT_FPS = 30.0
MILLIMETRES = 1000.0  # per metre
CAMERA_FILES = (CAMERA_FILE, "intrinsic.json")
"""As Open3D's recorder for RealSense names it, and its readers of bags and Azure Kinect recordings."""

NOMINAL = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
"""The camera of the first Kinect, if the camera is unknown."""

Positive = Annotated[float, Meta(gt=0)]
Side = Annotated[int, Meta(ge=1, le=32_768)]


class CameraFile(msgspec.Struct):
    """The content of `camera_intrinsic.json`; other keys are ignored."""

    width: Side
    height: Side
    intrinsic_matrix: Annotated[list[float], Meta(min_length=9, max_length=9)]  # column by column
    depth_scale: Positive = MILLIMETRES
    fps: Positive = DEFAULT_FPS


class PartialCameraFile(CameraFile):
    """A camera file that may lack size and intrinsics, because the user gives the intrinsics."""

    width: Side | None = None  # type: ignore[assignment]
    height: Side | None = None  # type: ignore[assignment]
    intrinsic_matrix: object = None  # type: ignore[assignment]


def find_camera_file(folder: Path) -> Path | None:
    """The camera of a recorded folder, as Open3D's recorders name it; None if there is none."""
    return next((file for name in CAMERA_FILES if (file := folder / name).exists()), None)


def read_camera(folder: Path, given: GivenCamera | None = None) -> tuple[Intrinsics, float, float]:
    """Read intrinsics, units of depth per metre and frames per second of a folder; InputError if damaged.

    If the user gives intrinsics, the file needs none, and its default size is that of the nominal camera.
    """
    missing = "add --intrinsics fx,fy,cx,cy (pixels), or write it (docs/formats.md)"
    path = find_camera_file(folder) or folder / CAMERA_FILE
    if given is not None and given.intrinsics is not None:
        part = read_json(path, PartialCameraFile, "correct that entry", missing)
        size = part.width or NOMINAL.width, part.height or NOMINAL.height
        return intrinsics_of(given.matrix(path), *size, str(path)), part.depth_scale, part.fps
    camera = read_json(path, CameraFile, "correct that entry", missing)
    matrix = np.reshape(camera.intrinsic_matrix, (3, 3)).T
    intrinsics = intrinsics_of(matrix, camera.width, camera.height, f"{path}, read column by column")
    return intrinsics, camera.depth_scale, camera.fps


def write_camera(path: Path, camera: Intrinsics, depth_scale: float, fps: float = DEFAULT_FPS) -> None:
    """Write a camera as Open3D's recorders do."""
    matrix = [camera.fx, 0.0, 0.0, 0.0, camera.fy, 0.0, camera.cx, camera.cy, 1.0]
    content = CameraFile(camera.width, camera.height, matrix, depth_scale, fps)
    write_json(path, content)


def intrinsics_of(matrix: ArrayLike, width: int, height: int, name: str) -> Intrinsics:
    """Intrinsics from a matrix (3, 3); InputError if it is not that of a pinhole camera without skew."""
    values = np.asarray(matrix)
    if values.shape != (3, 3) or values.dtype.kind not in "iuf" or min(width, height) < 1:
        raise InputError(f"{name}: intrinsics are not a 3 x 3 matrix; give fx 0 cx, 0 fy cy, 0 0 1")
    (fx, _, cx), (_, fy, cy), _ = values.astype(np.float64).tolist()
    good = values.tolist() == [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] and min(fx, fy) > 0
    if not (good and np.isfinite([fx, fy, cx, cy]).all()):
        raise InputError(
            f"{name}: intrinsics are not fx 0 cx, 0 fy cy, 0 0 1; give them with positive fx, fy"
        )
    return Intrinsics(width, height, fx, fy, cx, cy)


@dataclass(frozen=True, slots=True)
class GivenCamera:
    """The user's fx, fy, cx, cy in pixels, and units per metre; None for those of the recording.

    mirrored: whether its images are mirrored, and are mirrored back; None if the user does not say. The
    intrinsics are those of the images as they were recorded.
    """

    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None
    mirrored: bool | None = None

    def matrix(self, path: Path) -> list[list[float]]:
        """The user's camera matrix (3, 3); InputError if the recording at `path` needs one."""
        if self.intrinsics is None:
            raise InputError(f"{path} does not contain its camera; add --intrinsics fx,fy,cx,cy (pixels)")
        fx, fy, cx, cy = self.intrinsics
        return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]

    def camera(self, shape: tuple[int, ...], path: Path) -> Intrinsics:
        """The user's camera for images of a shape (H, W); InputError as for `matrix`."""
        return intrinsics_of(self.matrix(path), shape[1], shape[0], str(path))


AS_RECORDED = GivenCamera()


def parse_camera(
    intrinsics: str | None, depth_scale: float | None, mirrored: bool | None = None
) -> GivenCamera:
    """Parse the values of the command line; InputError if they are invalid."""
    if depth_scale is not None and not SMALLEST <= depth_scale <= LARGEST:
        raise InputError(
            f"--depth-scale {depth_scale:g} is not between {SMALLEST:g} and {LARGEST:g}; correct it"
        )
    if intrinsics is None:
        return GivenCamera(None, depth_scale, mirrored)
    try:
        fx, fy, cx, cy = (float(part) for part in intrinsics.split(","))
    except ValueError:
        raise InputError(f"--intrinsics '{intrinsics}' is not fx,fy,cx,cy; give four numbers") from None
    given = GivenCamera((fx, fy, cx, cy), depth_scale, mirrored)
    given.camera((1, 1), Path("--intrinsics"))
    return given
