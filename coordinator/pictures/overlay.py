"""One frame as a picture: observed depth, the model over it, the skeletons of all hypotheses, a caption."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib import font_manager
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_dilation

from common.body import BodyModel
from common.camera import Intrinsics, project
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from coordinator.pictures.plots import STATUS
from coordinator.pictures.shading import contours, lambert, shade_depth
from coordinator.results.track import Track
from coordinator.synthesis.rendering import DepthRenderer

SMALLEST = 2  # pixels of a window's side
MARGIN_M = 0.25  # around the joints: half a torso, a hand, the top of the head


@dataclass(frozen=True, slots=True)
class View:
    """A window of a camera's image, `scale` picture pixels for one of the image's."""

    camera: Intrinsics  # of the whole image
    left: int
    top: int
    columns: int
    rows: int
    scale: float

    @property
    def width(self) -> int:
        """Of the picture, pixels."""
        return max(1, round(self.columns * self.scale))

    @property
    def height(self) -> int:
        """Of the picture, pixels."""
        return max(1, round(self.rows * self.scale))

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera whose image is the picture."""
        s, whole = self.scale, self.camera
        cx, cy = ((c + 0.5) * s - 0.5 for c in (whole.cx - self.left, whole.cy - self.top))
        return Intrinsics(self.width, self.height, whole.fx * s, whole.fy * s, cx, cy)

    @property
    def window(self) -> Intrinsics:
        """The camera whose image is the window, at the image's own size."""
        return self.camera.crop(self.left, self.top, self.columns, self.rows)

    def crop(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """The window (rows, columns) of an image (H, W)."""
        return image[self.top : self.top + self.rows, self.left : self.left + self.columns]

    def resized(self, factor: float) -> View:
        """The same window at another size."""
        return View(self.camera, self.left, self.top, self.columns, self.rows, self.scale * factor)


def around(track: Track, camera: Intrinsics, width: int, height: int) -> View:
    """The view that shows all joints of all frames, and fits into width x height pixels.

    Where a lost body is said to be does not count, unless it is lost all the time.
    """
    kept = ~track.unknown
    points = track.joint_positions[kept if kept.any() else ...].reshape(-1, 3)
    points = points[np.all(np.isfinite(points), axis=1) & (points[:, 2] > MARGIN_M)]
    size = np.array([camera.width, camera.height])
    low, high = np.zeros(2, dtype=int), size
    if len(points):
        pixels, reach = project(points, camera), camera.fx * MARGIN_M / points[:, 2:]
        low = np.clip(np.floor((pixels - reach).min(axis=0)), 0, size - SMALLEST).astype(int)
        high = np.clip(np.ceil((pixels + reach).max(axis=0)), low + SMALLEST, size).astype(int)
    (left, top), (columns, rows) = low.tolist(), (high - low).tolist()
    return View(camera, left, top, columns, rows, min(width / columns, height / rows))


TRUNK = (("pelvis", "neck"), ("neck", "head"))
HALF = (
    ("neck", "{}_shoulder"),
    ("{}_shoulder", "{}_elbow"),
    ("{}_elbow", "{}_wrist"),
    ("pelvis", "{}_hip"),
    ("{}_hip", "{}_knee"),
    ("{}_knee", "{}_ankle"),
)
LINES = (*TRUNK, *((a.format(side), b.format(side)) for side in ("right", "left") for a, b in HALF))


def bones(joint_names: tuple[str, ...]) -> list[tuple[int, int]]:
    """Pairs of joint indices to join by a line; joints that no line of a person's names stay dots."""
    at = {name: j for j, name in enumerate(joint_names)}
    return [(at[a], at[b]) for a, b in LINES if a in at and b in at]


Array = NDArray[np.float64]
Colours = NDArray[np.float32]  # (H, W, 3), 0-255

FINER = 2  # the picture is drawn at this multiple and averaged
BACKGROUND = np.array([19.0, 23.0, 31.0], dtype=np.float32)
MODEL_COLOUR = np.array([255.0, 122.0, 28.0], dtype=np.float32)
MODEL_OPACITY, CONTOUR_OPACITY, CONTOUR_JUMP_M = 0.38, 0.9, 0.06
FARTHEST = 1e4  # pixels outside the picture that a line may go
SKELETON_COLOUR, OTHERS_COLOUR = (255, 255, 255), (92, 214, 255)
TITLE_COLOUR, EDGE = (235, 238, 243), (19, 23, 31)
WHOLE = ((0.0, 1.0),)  # parts of a line
DASHES = tuple((k / 5.0 + 0.05, k / 5.0 + 0.15) for k in range(5))
FAINTEST = 0.15  # opacity of a hypothesis without weight; the likeliest is opaque


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What the tracker said about a frame: the reported pose (D,), all hypotheses (M, D), the status.

    The hypotheses' weights (M,) are NaN where there are fewer than M. Joints (J,) that may well be off are
    `flagged`: they are drawn hollow, and what leads to them dashed.
    """

    pose: Array
    hypotheses: Array
    weights: Array
    status: str
    flagged: NDArray[np.bool_] | None = None

    @property
    def there(self) -> bool:
        """Whether there is a body to draw: it was found by then, and is in the picture."""
        return bool(np.isfinite(self.pose).all()) and self.status != "absent"


class Painter:
    """Paints frames of one run in one view; without OpenGL the model is drawn as its vertices."""

    def __init__(self, model: BodyModel, view: View, opengl: bool = True, finer: int = FINER) -> None:
        self.model, self.view, self._finer = model, view, finer
        self._fine = view.resized(finer)
        self._renderer = DepthRenderer(self._fine.intrinsics) if opengl else None

    def paint(
        self, frame: DepthFrame, shown: Shown, title: str | None = None, colour: Image.Image | None = None
    ) -> Image.Image:
        """The picture of a frame, RGB, of the view's size; over its colour image, if there is one."""
        canvas = self._paint_depth(frame) if colour is None else self._paint_colour(colour)
        if shown.there:
            canvas = self._paint_model(canvas, shown.pose)
        picture = Image.fromarray(canvas.astype(np.uint8))
        if shown.there:
            self._draw_skeletons(picture, shown)
        picture = picture.resize((self.view.width, self.view.height), Image.Resampling.BOX)
        write_caption(picture, title or f"{frame.number}", shown.status)
        return picture

    def close(self) -> None:
        """Release the OpenGL context."""
        if self._renderer is not None:
            self._renderer.close()

    def _paint_depth(self, frame: DepthFrame) -> Colours:
        depth = self.view.crop(frame.metres())
        colours = np.where((depth > 0.0)[..., None], shade_depth(depth, self.view.window), BACKGROUND)
        size = (self._fine.width, self._fine.height)
        picture = Image.fromarray(colours.astype(np.uint8)).resize(size, Image.Resampling.BILINEAR)
        return np.asarray(picture, dtype=np.float32)

    def _paint_colour(self, colour: Image.Image) -> Colours:
        view = self.view
        x, y = colour.width / view.camera.width, colour.height / view.camera.height
        box = (view.left * x, view.top * y, (view.left + view.columns) * x, (view.top + view.rows) * y)
        size = (self._fine.width, self._fine.height)
        return np.asarray(colour.resize(size, Image.Resampling.BILINEAR, box=box), dtype=np.float32)

    def _paint_model(self, canvas: Colours, pose: Array) -> Colours:
        vertices = pose_vertices(self.model, pose[None])[0]
        if self._renderer is None:
            return self._paint_vertices(canvas, vertices)
        depth = self._renderer.depth(vertices, self.model.triangles)
        light = 0.45 + 0.55 * lambert(depth, self._fine.intrinsics)
        lines = binary_dilation(contours(depth, CONTOUR_JUMP_M))
        opacity = np.where(lines, CONTOUR_OPACITY, MODEL_OPACITY * (depth > 0.0))[..., None]
        colour = MODEL_COLOUR * np.where(lines, 1.0, light)[..., None]
        painted: Colours = canvas + (colour - canvas) * opacity.astype(np.float32)
        return painted

    def _paint_vertices(self, canvas: Colours, vertices: Array) -> Colours:
        dots = np.floor(project(vertices[vertices[:, 2] > 0.0], self._fine.intrinsics)).astype(int)
        square = np.indices((self._finer, self._finer)).reshape(2, -1).T  # one pixel of the picture
        pixels = (dots[:, None] + square).reshape(-1, 2)
        inside = np.all((pixels >= 0) & (pixels < (canvas.shape[1], canvas.shape[0])), axis=1)
        columns, rows = pixels[inside].T
        painted = canvas.copy()
        painted[rows, columns] = MODEL_COLOUR
        return painted

    def _draw_skeletons(self, picture: Image.Image, shown: Shown) -> None:
        draw = ImageDraw.Draw(picture, "RGBA")
        width = max(2, picture.height // 160)
        order = np.argsort(shown.weights)[: np.isfinite(shown.weights).sum()]  # the likely over the unlikely
        strengths = shown.weights[order] / shown.weights[order].max(initial=np.finfo(float).tiny)
        skeletons = joint_positions(self.model, shown.hypotheses[order])
        for joints, opacity in zip(skeletons, FAINTEST + (1.0 - FAINTEST) * strengths, strict=True):
            self._draw_skeleton(draw, joints, (*OTHERS_COLOUR, round(255 * opacity)), width // 2, None)
        reported = joint_positions(self.model, shown.pose[None])[0]
        self._draw_skeleton(draw, reported, (0, 0, 0), width + 2, shown.flagged)
        self._draw_skeleton(draw, reported, SKELETON_COLOUR, width, shown.flagged)

    def _draw_skeleton(
        self,
        draw: ImageDraw.ImageDraw,
        joints: Array,
        colour: tuple[int, ...],
        width: int,
        flagged: NDArray[np.bool_] | None,
    ) -> None:
        if np.any(joints[:, 2] <= 0.0):
            return
        doubted = np.zeros(len(joints), dtype=bool) if flagged is None else flagged
        pixels = np.clip(project(joints, self._fine.intrinsics), -FARTHEST, FARTHEST)
        for a, b in bones(self.model.joint_names):
            for start, end in DASHES if doubted[a] or doubted[b] else WHOLE:
                ends = pixels[a] + np.array([[start], [end]]) * (pixels[b] - pixels[a])
                draw.line(ends.ravel().tolist(), fill=colour, width=width)
        for (x, y), hollow in zip(pixels, doubted, strict=True):
            size = 2 * width if hollow else width
            ring = {"outline": colour, "width": max(1, width // 2)} if hollow else {"fill": colour}
            draw.ellipse([x - size, y - size, x + size, y + size], **ring)


def write_caption(picture: Image.Image, title: str, status: str) -> None:
    """Write the title and the status at the top, in place."""
    draw = ImageDraw.Draw(picture)
    size = max(11, picture.height // 22)
    left, right = (size // 2, size // 3), (picture.width - size // 2, size // 3)
    for text, place, colour, anchor in (
        (title, left, TITLE_COLOUR, "la"),
        (status, right, STATUS[status], "ra"),
    ):
        draw.text(place, text, colour, font(size), anchor, stroke_width=max(1, size // 10), stroke_fill=EDGE)


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """The typeface that matplotlib brings along."""
    return ImageFont.truetype(font_manager.findfont("DejaVu Sans"), size)
