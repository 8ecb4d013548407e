"""A contact sheet: pictures of frames that are evenly spread over a run."""

from __future__ import annotations

import numpy as np
from PIL import Image

GAP = 4  # pixels
GROUND = (9, 11, 15)


def spread(count: int, wanted: int) -> list[int]:
    """At most `wanted` positions out of `count`, evenly spread, the first and the last among them."""
    return sorted(set(np.rint(np.linspace(0, count - 1, min(count, wanted))).astype(int).tolist()))


def tile(pictures: list[Image.Image], columns: int) -> Image.Image:
    """Pictures of one size side by side, row by row."""
    width, height = pictures[0].size
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * (width + GAP) + GAP, rows * (height + GAP) + GAP), GROUND)
    for i, picture in enumerate(pictures):
        row, column = divmod(i, columns)
        sheet.paste(picture, (GAP + column * (width + GAP), GAP + row * (height + GAP)))
    return sheet
