"""Colour frames of a depth sequence: any images with numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources.picture_folders import opened
from gepf.coordinator.sources.source import RigSource, Source

COLOUR_FORMATS = ("PNG", "JPEG")
FOLDER = "color"  # beside depth


class ColourFolder:
    """Colour frames that show what the depth camera sees, at any scale; mirrored back if depth is.

    Raises InputError unless each of `numbers` has a colour frame, with the aspect ratio of the depth.
    """

    def __init__(
        self, path: Path, camera: Intrinsics, numbers: Sequence[int], *, mirrored: bool = False
    ) -> None:
        self._mirrored = mirrored
        if not path.is_dir():
            raise InputError(f"no such folder of colour frames: {path}; give another --color")
        self._files = numbered(path)
        missing = [number for number in numbers if number not in self._files]
        if missing:
            raise InputError(
                f"{path} lacks {len(missing)} of {len(numbers)} colour frames, first {missing[0]}; add them"
            )
        for number in numbers:
            with opened(self._files[number], *COLOUR_FORMATS) as image:
                width, height = image.size
            if not fits(width, height, camera):
                raise InputError(
                    f"{self._files[number]} has another shape than the depth; register colour to depth"
                )

    def frame(self, number: int) -> Image.Image:
        """One frame, RGB; InputError if it is damaged."""
        with opened(self._files[number], *COLOUR_FORMATS) as image:
            colours = image.convert("RGB")
        return ImageOps.mirror(colours) if self._mirrored else colours


def numbered(folder: Path) -> dict[int, Path]:
    """The images in a folder by the last number in their names."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in (".png", ".jpg", ".jpeg"))
    digits = [re.findall(r"\d+", file.stem) for file in files]
    return {int(found[-1]): file for found, file in zip(digits, files, strict=True) if found}


def fits(width: int, height: int, camera: Intrinsics) -> bool:
    """Whether a colour image has the shape of the depth image."""
    return abs(width * camera.height / camera.width - height) <= 1.0


def with_colours(source: Source, folder: Path | None = None) -> Source:
    """The same sequence with colour: of a folder, or of `color/` beside the depth of each camera.

    A colour image that is missing, damaged, or of another shape than depth is left out. InputError if there
    is no such folder.
    """
    if isinstance(source, RigSource):
        first, *beside = source.views
        views = with_colours(first, folder), *map(with_colours, beside)
        return source.changed(views=views, colours=views[0].colours)
    if folder is None and source.folder is not None and (source.folder / FOLDER).is_dir():
        folder = source.folder / FOLDER
    elif folder is not None and not folder.is_dir():
        raise InputError(f"no such folder of colour frames: {folder}; give another --color")
    files = {} if folder is None else numbered(folder)
    if not files:
        return source

    def read(number: int) -> NDArray[np.uint8] | None:
        if number not in files:
            return None
        try:
            with opened(files[number], *COLOUR_FORMATS) as image:
                colours = image.convert("RGB")
        except InputError:
            return None
        if not fits(*colours.size, source.intrinsics):
            return None
        return np.array(ImageOps.mirror(colours) if source.mirrored else colours)

    return source.changed(colours=read)
