"""Colour frames of a depth sequence, for drawing: any images with numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from common.camera import Intrinsics
from common.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg")


class ColourFolder:
    """Colour frames of the depth camera, or registered to it, of its size or scaled.

    Raises InputError unless there is one for each of `numbers`, all of the camera's shape.
    """

    def __init__(self, path: Path, camera: Intrinsics, numbers: Sequence[int]) -> None:
        if not path.is_dir():
            raise InputError(f"no such folder of colour frames: {path}; give another --color")
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        digits = [re.findall(r"\d+", file.stem) for file in files]
        self._files = {int(found[-1]): file for found, file in zip(digits, files, strict=True) if found}
        missing = [number for number in numbers if number not in self._files]
        if missing:
            raise InputError(
                f"{path} has no colour frame {missing[0]} ({len(missing)} of {len(numbers)} are missing); "
                "number them as the depth frames, as in 000000.png"
            )
        self._camera = camera
        for number in numbers:
            with self._open(self._files[number]):
                pass

    def frame(self, number: int) -> Image.Image:
        """One frame, RGB; InputError if it is damaged."""
        file = self._files[number]
        with self._open(file) as opened:
            try:
                return opened.convert("RGB")
            except (OSError, SyntaxError, ValueError) as error:
                raise InputError(f"{file} is damaged; copy it again") from error

    def _open(self, file: Path) -> Image.Image:
        try:
            opened = Image.open(file)
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise InputError(f"{file} is damaged or not an image; copy it again") from error
        camera = self._camera
        if abs(opened.width * camera.height / camera.width - opened.height) > 1.0:
            opened.close()
            raise InputError(
                f"{file} is {opened.width}x{opened.height}, not in the shape of the depth, "
                f"{camera.width}x{camera.height}; register colour to depth, or leave --color out"
            )
        return opened
