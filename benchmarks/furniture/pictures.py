"""Contact sheets: depth, the reported body over it, its skeleton, and the true one in green."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.furniture.footage import Footage
from gepf.common.camera import project
from gepf.coordinator.palette import PALETTE, Colour
from gepf.coordinator.pictures.overlay import draw_skeleton, write_caption
from gepf.coordinator.pictures.shading import draw_body, shade_depth
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.reporting import TrackedPerson

TRUE_COLOUR: Colour = (64, 220, 96)
LINE_PX = 2
COLUMNS = 2  # strips of a sheet side by side


def draw_strip(
    footage: Footage, found: Sequence[TrackedPerson], shown: Sequence[int], title: str
) -> Image.Image:
    """Some frames side by side, bare depth first."""
    bare = shade_depth(footage.frames[shown[0]].views[0].metres(), footage.frames[0].views[0].intrinsics)
    pictures = [bare, *(draw_frame(footage, found[n], n, title) for n in shown)]
    strip = Image.new("RGB", (len(pictures) * bare.width, bare.height))
    for n, picture in enumerate(pictures):
        strip.paste(picture, (n * bare.width, 0))
    return strip


def draw_frame(footage: Footage, found: TrackedPerson, n: int, title: str) -> Image.Image:
    """One frame."""
    (view,), estimate, model = footage.frames[n].views, found.estimate, found.state.start.model
    picture = shade_depth(view.metres(), view.intrinsics)
    known = estimate.status not in POSE_UNKNOWN and bool(np.isfinite(estimate.joint_positions).all())
    if known:
        pose = found.state.start.pose.copy()
        pose[model.moves] = estimate.pose
        picture = draw_body(picture, model, pose, view.intrinsics, 0.5)
    draw = ImageDraw.Draw(picture, "RGBA")
    true = project(footage.joints[n], view.intrinsics)
    draw_skeleton(draw, model, true, TRUE_COLOUR, LINE_PX, ~footage.visible[n])
    if known:
        draw_skeleton(
            draw, model, project(estimate.joint_positions, view.intrinsics), PALETTE.skeleton, LINE_PX
        )
    write_caption(picture, f"{title} {n}", estimate.status, estimate.why[:60])
    return picture


def sheet_of(strips: Sequence[Image.Image]) -> Image.Image:
    """Strips of one size, side by side and below each other."""
    width, height = strips[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(strips) // COLUMNS) * height))
    for n, strip in enumerate(strips):
        sheet.paste(strip, (n % COLUMNS * width, n // COLUMNS * height))
    return sheet
