"""A folder as Open3D's recorders write it: depth/000000.png and camera_intrinsic.json."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame

CAMERA_FILE = "camera_intrinsic.json"
DEFAULT_FPS = 30.0
SIXTEEN_BIT_GREY = "I;16"

Positive = Annotated[float, Meta(gt=0)]
Size = Annotated[int, Meta(ge=1, le=32_768)]


class CameraFile(msgspec.Struct):
    """`camera_intrinsic.json`; keys that other programs add are passed over."""

    width: Size
    height: Size
    intrinsic_matrix: Annotated[list[float], Meta(min_length=9, max_length=9)]  # column by column
    depth_scale: Positive
    fps: Positive = DEFAULT_FPS


class RecordedFolder:
    """A depth sequence in a folder. `numbers` are those of the file names, which must be consecutive."""

    def __init__(self, path: Path) -> None:
        self.name = path.resolve().name
        self._files = find_depth_files(path)
        camera = read_camera(path / CAMERA_FILE)
        self.intrinsics = pinhole(camera, path / CAMERA_FILE)
        self.depth_scale = camera.depth_scale
        self.fps = camera.fps
        self.numbers = range(min(self._files), max(self._files) + 1)
        self.truth = _if_there(path / "truth.npz")
        self.init = _if_there(path / "init.json")

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        return DepthFrame(number, number / self.fps, depth, self.depth_scale, self.intrinsics)

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[DepthFrame]:
        return map(self.frame, self.numbers)


def find_depth_files(path: Path) -> dict[int, Path]:
    """Frame number -> file, for all of `path`/depth; InputError if there is none or one is missing."""
    try:
        files = [f for f in (path / "depth").glob("*.png") if not f.name.startswith(".")]
    except OSError as error:
        raise InputError(f"cannot read {path / 'depth'}: {error.strerror}; mend its permissions") from error
    odd = next((f for f in files if not f.stem.isdecimal()), None)
    if odd is not None:
        raise InputError(f"{odd} is not named by a frame number such as 000000.png; rename or remove it")
    if not files:
        raise InputError(
            f"{path} holds no depth/000000.png; give a folder as Open3D's recorders write it "
            f"(depth/*.png and {CAMERA_FILE})"
        )
    numbered = {int(f.stem): f for f in files}
    if len(numbered) < len(files):
        raise InputError(f"{path / 'depth'} names a frame number twice; remove one file of each pair")
    missing = next((n for n in range(min(numbered), max(numbered)) if n not in numbered), None)
    if missing is not None:
        raise InputError(
            f"{path / 'depth'} has no frame {missing}, though there are later ones; "
            "put it back or number the frames without gaps"
        )
    return numbered


def read_camera(path: Path) -> CameraFile:
    """The camera file's content with types and ranges checked."""
    try:
        content = json.loads(path.read_bytes(), parse_constant=_refuse_constant)
        return msgspec.convert(content, CameraFile)
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing; write it with width, height, intrinsic_matrix (9 numbers, column by column) "
            "and depth_scale (units per metre)"
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


def read_depth(path: Path, camera: Intrinsics) -> NDArray[np.uint16]:
    """Depth (H, W) of a 16-bit PNG; InputError if it is damaged, of another depth or another size."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            _check_form(image, path, camera)
            image.verify()  # all checksums: decoding alone lets a missing end and altered last bytes pass
        with Image.open(path, formats=["PNG"]) as image:
            return np.asarray(image).astype(np.uint16, copy=False)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} is damaged or no PNG ({_reason(error)}); copy it again") from error


def _check_form(image: Image.Image, path: Path, camera: Intrinsics) -> None:
    if image.mode != SIXTEEN_BIT_GREY:
        kind = {"1": "1-bit", "L": "8-bit"}.get(image.mode, f"of kind {image.mode}")
        raise InputError(
            f"{path} is {kind}, not 16-bit grey; save depth as uint16 with depth_scale units per metre"
        )
    if image.size != (camera.width, camera.height):
        width, height = image.size
        raise InputError(
            f"{path} is {width}x{height}, but {CAMERA_FILE} says {camera.width}x{camera.height}; "
            "all frames must have the camera's size"
        )


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return "cut short or not a picture" if "cannot identify" in str(error) else str(error)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number that a camera can have")


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None
