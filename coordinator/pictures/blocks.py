"""A picture in a terminal: half blocks, two pixels a character."""

from __future__ import annotations

import numpy as np
from PIL import Image
from rich.style import Style
from rich.text import Text

COLUMNS, LINES = 60, 24  # at the most


def in_blocks(picture: Image.Image, columns: int = COLUMNS) -> Text:
    """An RGB picture, made smaller to fit: upper pixels as characters, lower ones as their ground."""
    small = picture.copy()
    small.thumbnail((min(columns, COLUMNS), 2 * LINES))
    pixels = np.asarray(small)[: small.height // 2 * 2]
    lines = [
        Text.assemble(*(("\u2580", style(up, low)) for up, low in zip(upper, lower, strict=True)))
        for upper, lower in zip(pixels[::2].tolist(), pixels[1::2].tolist(), strict=True)
    ]
    return Text("\n").join(lines)


def style(upper: list[int], lower: list[int]) -> Style:
    """The style of one character."""
    return Style(color=in_hex(upper), bgcolor=in_hex(lower))


def in_hex(colour: list[int]) -> str:
    """A colour (3,), 0-255, as rich names it."""
    return "#" + "".join(f"{part:02x}" for part in colour)
