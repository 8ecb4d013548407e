"""What is found in a scene, for looking at: floor, walls, and whoever may be a person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from coordinator.pictures.shading import shade_depth
from coordinator.scene.candidates import Candidate
from coordinator.scene.room import ON_PLANE, SceneView

FLOOR, WALL = (70, 150, 90), (80, 110, 170)  # tints
OUTLINES = ((255, 200, 60), (255, 120, 60), (200, 90, 200), (150, 150, 150))  # of candidates, best first


def draw_scene(view: SceneView, found: Sequence[Candidate]) -> Image.Image:
    """A frame with the floor green, walls blue, and candidates outlined and numbered, the best first."""
    picture = shade_depth(view.depth, view.camera)
    planes = view.planes.coefficients
    for n in range(len(planes)):
        on = view.marks(planes[n : n + 1]) == ON_PLANE
        tint = FLOOR if n == 0 and view.planes.has_floor else WALL
        picture[on] = 0.5 * picture[on] + 0.5 * np.array(tint, dtype=np.float32)
    for n, candidate in reversed(list(enumerate(found))):
        picture[outline(candidate.mask)] = OUTLINES[min(n, len(OUTLINES) - 1)]
    image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    for n, candidate in enumerate(found):
        rows, columns = np.nonzero(candidate.mask)
        top = int(rows.min())
        draw.text((int(columns[rows == top].mean()), max(0, top - 12)), str(n + 1), fill=(255, 255, 255))
    return image


def outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels (H, W) of a mask that have a neighbour outside."""
    padded = np.pad(mask, 1)
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask & ~inside
