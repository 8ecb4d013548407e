"""A picture of a scene: floor, walls and candidates for people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import binary_erosion

from gepf.coordinator.palette import PALETTE
from gepf.coordinator.pictures.shading import shade_depth
from gepf.coordinator.scene.candidates import Candidate
from gepf.coordinator.scene.scene import ON_PLANE, SceneView, mark_pixels


def draw_scene(view: SceneView, found: Sequence[Candidate]) -> Image.Image:
    """A frame with green floor, blue walls, and outlined and numbered candidates, the best first."""
    picture = np.array(shade_depth(view.depth, view.intrinsics))
    planes, outlines = view.planes.coefficients, PALETTE.candidates
    for n in range(len(planes)):
        marks = mark_pixels(
            view.depth, view.background, view.intrinsics.pinhole, planes[n : n + 1], view.noise
        )
        on = marks == ON_PLANE
        colour = PALETTE.floor if n == 0 and view.planes.has_floor else PALETTE.wall
        picture[on] = picture[on] // 2 + np.array(colour) // 2
    for n, candidate in reversed(list(enumerate(found))):
        picture[candidate.mask & ~binary_erosion(candidate.mask)] = outlines[min(n, len(outlines) - 1)]
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    for n, candidate in enumerate(found):
        rows, columns = np.nonzero(candidate.mask)
        draw.text((float(np.median(columns)), float(rows.min())), str(n + 1), anchor="mb")
    return image
