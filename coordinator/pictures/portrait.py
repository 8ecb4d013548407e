"""A body at rest from three sides, with its named joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from common.body import BodyModel
from common.camera import Intrinsics
from common.kinematics import pose_vertices
from coordinator.pictures.film import save_png, tile
from coordinator.pictures.overlay import FINER, SKELETON_COLOUR, draw_skeleton, project_joints
from coordinator.pictures.shading import BACKGROUND, draw_body
from coordinator.synthesis.rendering import fit_in_view

CAMERA = Intrinsics(720, 960, 1800.0, 1800.0, 359.5, 479.5)
TURNS_DEG = (0, 40, 90)


def draw_portrait(model: BodyModel, file: Path) -> None:
    """Write a PNG: the body from the front, obliquely and from the side, with joints as dots."""
    save_png(tile([paint(model, turn) for turn in TURNS_DEG]), file)


def paint(model: BodyModel, turn_deg: float) -> Image.Image:
    """The body rotated about the vertical; named joints are dots, connected by lines for a person."""
    pose = np.clip(np.zeros(len(model.dof_names)), *model.limits.T)
    pose[model.dof("root_ry")] = np.radians(turn_deg)
    pose[:3] = fit_in_view(pose_vertices(model, pose[None])[0], CAMERA)
    picture = Image.new("RGB", (CAMERA.width, CAMERA.height), BACKGROUND)
    picture = draw_body(picture, model, pose, CAMERA, opacity=1.0)
    (pixels,) = project_joints(model, pose[None], CAMERA)
    draw_skeleton(ImageDraw.Draw(picture), model, pixels, SKELETON_COLOUR, 2 * FINER)
    return picture.reduce(FINER)
