"""Depth as a 16-bit PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from common.errors import InputError
from coordinator.files.names import CAMERA_FILE

SIXTEEN_BIT_GREY = "I;16"


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


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height, from the file's head; InputError if it is damaged."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            return image.size
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
