"""One frame as a picture: observed depth, the model over it, the skeletons of all hypotheses, a caption."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from PIL import Image, ImageDraw

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import NOT_MOVED, Intrinsics, moved, project
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.families import FAMILIES
from gepf.coordinator.palette import PALETTE, STATUS
from gepf.coordinator.pictures.shading import draw_body
from gepf.coordinator.results.track import Track


class DrawingSettings(msgspec.Struct, frozen=True):
    """How a body is drawn."""

    finer: int = 2  #: multiple of the picture's size in which it is drawn, and then averaged
    margin_m: float = 0.25  #: around the joints: half a torso, a hand, the top of the head


DRAWING = DrawingSettings()


@dataclass(frozen=True, slots=True)
class Viewport:
    """A window of a camera's image, in pixels of that image, and the size in which it is drawn."""

    camera: Intrinsics  # of the whole image
    left: float
    top: float
    scale: float  # pixels of the picture per pixel of the image
    width: int  # of the picture
    height: int
    placed: Array = field(default_factory=NOT_MOVED.copy, compare=False)  # T_camera_rig

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera whose image is the picture."""
        s, whole = self.scale, self.camera
        cx, cy = ((c + 0.5) * s - 0.5 for c in (whole.cx - self.left, whole.cy - self.top))
        return Intrinsics(self.width, self.height, whole.fx * s, whole.fy * s, cx, cy)

    def cut(self, image: Image.Image) -> Image.Image:
        """The window of an image of the camera, in any resolution, as a picture."""
        x, y = image.width / self.camera.width, image.height / self.camera.height
        right, bottom = self.left + self.width / self.scale, self.top + self.height / self.scale
        box = (self.left * x, self.top * y, min(right * x, image.width), min(bottom * y, image.height))
        return image.resize((self.width, self.height), Image.Resampling.BILINEAR, box)


def view_around(
    track: Track, camera: Intrinsics, width: int, height: int, placed: Array = NOT_MOVED
) -> Viewport:
    """The view that shows all joints of all frames, and fits into width x height pixels.

    Its picture, which is `DRAWING.finer` times smaller, has an even size, as films need.

    Frames without a known pose are ignored, unless there are no others. `placed` is T_camera_rig (4, 4).
    """
    kept = ~track.unknown
    points = moved(track.joint_positions[kept if kept.any() else ...].reshape(-1, 3), placed)
    points = points[np.all(np.isfinite(points), axis=1) & (points[:, 2] > DRAWING.margin_m)]
    size = np.array([camera.width, camera.height])
    low, high = np.zeros(2), size
    if len(points):
        pixels, reach = project(points, camera), camera.fx * DRAWING.margin_m / points[:, 2:]
        low = np.clip((pixels - reach).min(axis=0), 0, size - 2)
        high = np.clip((pixels + reach).max(axis=0), low + 2, size)
    scale = float(np.min((width, height) / (high - low)))
    even = 2 * DRAWING.finer
    columns, rows = np.maximum(scale * (high - low) // even * even, even).astype(int).tolist()
    return Viewport(camera, float(low[0]), float(low[1]), scale, columns, rows, placed)


LINES = tuple(line for family in FAMILIES for line in family.lines)


def bones(joint_names: tuple[str, ...]) -> list[tuple[int, int]]:
    """Pairs of joint indices to connect by lines; other joints are drawn as dots."""
    at = {name: j for j, name in enumerate(joint_names)}
    return [(at[a], at[b]) for a, b in LINES if a in at and b in at]


def paint(
    image: Image.Image, view: Viewport, model: BodyModel, track: Track, f: int, note: str = ""
) -> Image.Image:
    """The picture, RGB, of frame number `f` of a track over its depth or colour image.

    Nothing is drawn before the body is found and while it is absent. Hypotheses with less weight are more
    transparent. Joints that are probably wrong are hollow.
    """
    picture, camera, status = view.cut(image), view.intrinsics, str(track.status[f])
    if track.placed[f] and status != "absent":
        picture = draw_body(picture, model, track.pose[f], camera, 0.5, view.placed)
        draw, width = ImageDraw.Draw(picture, "RGBA"), max(DRAWING.finer, picture.height // 160)
        weights = track.hypothesis_weight[f]
        order = np.argsort(weights)[: np.isfinite(weights).sum()]  # the most likely are drawn last
        skeletons = project_joints(model, track.hypothesis_pose[f, order], camera, view.placed)
        strengths = np.sqrt(weights[order] / weights[order].max(initial=np.finfo(float).tiny))
        for pixels, strength in zip(skeletons, strengths, strict=True):
            draw_skeleton(draw, model, pixels, (*PALETTE.hypotheses, round(255 * strength)), width // 2)
        (pixels,) = project_joints(model, track.pose[f][None], camera, view.placed)
        hollow = track.flagged[f]
        draw_skeleton(draw, model, pixels, (0, 0, 0), width + 2, hollow)
        draw_skeleton(draw, model, pixels, PALETTE.skeleton, width, hollow)
    picture = picture.reduce(DRAWING.finer)
    write_caption(picture, str(track.frame[f]), status, note)
    return picture


def project_joints(model: BodyModel, poses: Array, camera: Intrinsics, placed: Array = NOT_MOVED) -> Array:
    """Pixels (N, J, 2) of the joints in poses (N, D); limited to the surroundings of the picture."""
    joints = moved(joint_positions(model, poses), placed)
    joints[..., 2] = np.maximum(joints[..., 2], DRAWING.margin_m)
    size = np.array([camera.width, camera.height])
    return np.asarray(np.clip(project(joints, camera), -size, 2 * size))


def draw_skeleton(
    draw: ImageDraw.ImageDraw,
    model: BodyModel,
    pixels: Array,
    colour: tuple[int, ...],
    width: int,
    hollow: Mask | None = None,
) -> None:
    """Draw joints at pixels (J, 2) as dots, or rings where they are `hollow` (J,), and lines between them."""
    for a, b in bones(model.joint_names):
        draw.line([*pixels[a], *pixels[b]], fill=colour, width=width)
    for j, place in enumerate(pixels.tolist()):
        if hollow is None or not hollow[j]:
            draw.circle(place, width, fill=colour)
        else:
            draw.circle(place, 2 * width, outline=colour, width=max(1, width // 2))


def write_caption(picture: Image.Image, title: str, status: str, note: str) -> None:
    """Write the title and the status at the top and a note at the bottom, in place."""
    draw, size = ImageDraw.Draw(picture), max(11, picture.height // 22)
    edge = size // 3
    style: dict[str, Any] = {"font_size": size, "stroke_width": 1, "stroke_fill": PALETTE.background}
    draw.text((edge, edge), title, PALETTE.skeleton, anchor="la", **style)
    draw.text((picture.width - edge, edge), status, STATUS[status], anchor="ra", **style)
    draw.text((edge, picture.height - edge), note, PALETTE.skeleton, anchor="ld", **style)
