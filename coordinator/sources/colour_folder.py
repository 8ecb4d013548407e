"""Colour frames of a depth sequence, for drawing: any images with numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageOps

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources.picture_folders import opened

COLOUR_FORMATS = ("PNG", "JPEG")


class ColourFolder:
    """Colour frames of the depth camera, or registered to it, of its size or scaled; mirrored back like it.

    Raises InputError unless there is one for each of `numbers`, all of the camera's shape.
    """

    def __init__(
        self, path: Path, camera: Intrinsics, numbers: Sequence[int], *, mirrored: bool = False
    ) -> None:
        self._mirrored = mirrored
        if not path.is_dir():
            raise InputError(f"no such folder of colour frames: {path}; give another --color")
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in (".png", ".jpg", ".jpeg"))
        digits = [re.findall(r"\d+", file.stem) for file in files]
        self._files = {int(found[-1]): file for found, file in zip(digits, files, strict=True) if found}
        missing = [number for number in numbers if number not in self._files]
        if missing:
            raise InputError(
                f"{path} has no colour frame {missing[0]} ({len(missing)} of {len(numbers)}); add it"
            )
        for number in numbers:
            with opened(self._files[number], *COLOUR_FORMATS) as image:
                width, height = image.size
            if abs(width * camera.height / camera.width - height) > 1.0:
                raise InputError(
                    f"{self._files[number]} has another shape than the depth; register colour to depth"
                )

    def frame(self, number: int) -> Image.Image:
        """One frame, RGB; InputError if it is damaged."""
        with opened(self._files[number], *COLOUR_FORMATS) as image:
            colours = image.convert("RGB")
        return ImageOps.mirror(colours) if self._mirrored else colours
