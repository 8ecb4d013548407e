"""Depth images and bodies as pictures, lit from the upper left."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LightSource
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import NOT_MOVED, Intrinsics, moved, project
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.palette import PALETTE

LIGHT = LightSource()


def shade_depth(depth_m: NDArray[np.float32], camera: Intrinsics, smoothing_px: float = 1.5) -> Image.Image:
    """A picture of observed depth (H, W); pixels without depth have the background colour.

    `smoothing_px` is the standard deviation of a Gaussian filter against the noise of depth.
    """
    seen = depth_m > 0.0
    near, distance = np.percentile(depth_m[seen], [2, 50]) if seen.any() else (1.0, 1.0)
    weight = gaussian_filter(seen.astype(np.float32), smoothing_px)
    smooth = np.where(seen, gaussian_filter(depth_m, smoothing_px) / np.maximum(weight, 1e-6), distance)
    light = LIGHT.hillshade(-smooth, dx=distance / camera.fx, dy=distance / camera.fy)
    light *= np.sqrt(np.minimum(near / smooth, 1.0))  # distant surfaces are darker
    colours = np.where(seen[..., None], light[..., None] * PALETTE.depth, PALETTE.background)
    return Image.fromarray(colours.astype(np.uint8))


def draw_body(
    picture: Image.Image,
    model: BodyModel,
    pose: Array,
    camera: Intrinsics,
    opacity: float,
    placed: Array = NOT_MOVED,
) -> Image.Image:
    """The picture with the body's surface in a pose (D,) over it, and lines around nearer parts.

    Triangles that face the camera are drawn from far to near. An edge is drawn as a line if the neighbouring
    triangle faces away. `placed` (4, 4) leads from the frame of the pose to the camera.
    """
    corners = moved(pose_vertices(model, pose[None])[0], placed)[model.triangles]  # (T, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = (np.sum(normals * corners[:, 0], axis=1) < 0.0) & np.all(corners[..., 2] > 0.0, axis=1)
    triangles, corners, normals = model.triangles[facing], corners[facing], normals[facing]
    normals = normals * (1.0, -1.0, -1.0) / np.linalg.norm(normals, axis=1, keepdims=True)  # y up, z back
    light = 0.5 + 0.5 * np.clip(normals @ LIGHT.direction, 0.0, 1.0)
    fills = np.column_stack([light[:, None] * PALETTE.body, np.full(len(light), 255.0 * opacity)]).astype(int)
    edges = {edge for a, b, c in triangles.tolist() for edge in ((a, b), (b, c), (c, a))}
    pixels = project(corners, camera)
    layer = Image.new("RGBA", picture.size)
    draw = ImageDraw.Draw(layer)
    for t in np.argsort(-corners[..., 2].mean(axis=1)).tolist():
        ends, places = triangles[t].tolist(), pixels[t].tolist()
        draw.polygon([*map(tuple, places)], fill=tuple(fills[t].tolist()))
        for k in range(3):
            if (ends[(k + 1) % 3], ends[k]) not in edges:
                draw.line([*places[k], *places[(k + 1) % 3]], fill=PALETTE.body, width=3)
    return Image.alpha_composite(picture.convert("RGBA"), layer).convert("RGB")
