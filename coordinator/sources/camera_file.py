"""`camera_intrinsic.json` as Open3D's recorders write it, beside the frames of whatever format."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
from msgspec import Meta

from common.camera import Intrinsics
from common.errors import InputError

DEFAULT_FPS = 30.0
MILLIMETRES = 1000.0  # units per metre
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


def read_camera(path: Path) -> CameraFile:
    """The camera file's content with types and ranges checked."""
    try:
        content = json.loads(path.read_bytes(), parse_constant=_refuse_constant)
        return msgspec.convert(content, CameraFile)
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing; add --intrinsics fx,fy,cx,cy (pixels), or write it with width, height, "
            "intrinsic_matrix (9 numbers, column by column) and depth_scale (units per metre)"
        ) from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; mend its permissions") from error
    except (ValueError, RecursionError) as error:  # of json, of msgspec, of the text's encoding
        raise InputError(f"{path}: {error}; mend that entry") from error


def pinhole(camera: CameraFile, path: Path) -> Intrinsics:
    """Intrinsics from a matrix given column by column: fx 0 0  0 fy 0  cx cy 1."""
    matrix = camera.intrinsic_matrix
    numbers = [*matrix, camera.depth_scale, camera.fps]
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"{path}: a number is not finite; mend that entry")
    fx, fy, cx, cy = matrix[0], matrix[4], matrix[6], matrix[7]
    if matrix != [fx, 0, 0, 0, fy, 0, cx, cy, 1]:
        raise InputError(
            f"{path}: intrinsic_matrix is not [fx, 0, 0, 0, fy, 0, cx, cy, 1]; "
            "write it column by column and without skew"
        )
    if fx <= 0 or fy <= 0:
        raise InputError(f"{path}: focal lengths {fx:g} and {fy:g} must be positive; mend intrinsic_matrix")
    return Intrinsics(camera.width, camera.height, fx, fy, cx, cy)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number that a camera can have")
