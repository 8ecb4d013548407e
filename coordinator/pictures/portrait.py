"""A body at rest from three sides, with its named joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from common.body import BodyModel
from common.camera import Intrinsics, project
from common.kinematics import joint_positions, pose_vertices
from coordinator.files import write_atomically
from coordinator.pictures.film import tile
from coordinator.pictures.overlay import BACKGROUND, MODEL_COLOUR, SKELETON_COLOUR, bones
from coordinator.pictures.shading import contours, lambert
from coordinator.synthesis.rendering import DepthRenderer, fit_in_view

CAMERA = Intrinsics(720, 960, 1800.0, 1800.0, 359.5, 479.5)
TURNS_DEG = (0.0, 40.0, 90.0)
SHRUNK = 2  # drawn larger and averaged
JUMP_SHARE = 0.02  # of the distance: a step in depth that gets a line


def draw_portrait(model: BodyModel, file: Path) -> None:
    """Write a PNG: the body from the front, half from the side and from the side, joints as dots."""
    with DepthRenderer(CAMERA) as renderer:
        sheet = tile([paint(model, turn, renderer) for turn in TURNS_DEG], len(TURNS_DEG))
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, lambda opened: sheet.save(opened, "PNG"))


def paint(model: BodyModel, turn_deg: float, renderer: DepthRenderer) -> Image.Image:
    """The body turned about the vertical; named joints are dots, those of a person joined by lines."""
    pose = np.clip(np.zeros(len(model.dof_names)), *model.limits.T)
    pose[model.dof("root_ry")] = np.radians(turn_deg)
    pose[:3] = fit_in_view(pose_vertices(model, pose[None])[0], CAMERA)
    picture = Image.fromarray(shade(model, pose, renderer).astype(np.uint8))
    draw, pixels = ImageDraw.Draw(picture), project(joint_positions(model, pose[None])[0], CAMERA)
    for a, b in bones(model.joint_names):
        draw.line([*pixels[a], *pixels[b]], fill=SKELETON_COLOUR, width=3)
    for x, y in pixels:
        draw.ellipse([x - 6, y - 6, x + 6, y + 6], fill=SKELETON_COLOUR, outline=(0, 0, 0))
    size = (CAMERA.width // SHRUNK, CAMERA.height // SHRUNK)
    return picture.resize(size, Image.Resampling.BOX)


def shade(model: BodyModel, pose: NDArray[np.float64], renderer: DepthRenderer) -> NDArray[np.float32]:
    """Colours (H, W, 3), 0-255, of the lit surface."""
    depth = renderer.depth(pose_vertices(model, pose[None])[0], model.triangles)
    light = 0.3 + 0.7 * lambert(depth, CAMERA)
    light[contours(depth, JUMP_SHARE * pose[2])] = 0.15
    there = (depth > 0.0)[..., None]
    return np.where(there, MODEL_COLOUR * light[..., None], BACKGROUND).astype(np.float32)
