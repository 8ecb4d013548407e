"""Draws all pictures of a run into its folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from PIL import Image

from gepf.common.body import BodyModel
from gepf.common.camera import inverse
from gepf.common.frame import Frame
from gepf.coordinator.files import FILM_FILE, HYPOTHESES_FILE, SHEET_FILE
from gepf.coordinator.pictures.film import save_png, spread, tile, write_film
from gepf.coordinator.pictures.overlay import DRAWING, Viewport, paint, view_around
from gepf.coordinator.pictures.plots import draw_hypotheses
from gepf.coordinator.pictures.shading import shade_depth
from gepf.coordinator.results.evaluation import Truth
from gepf.coordinator.results.track import Track, TrackedBody
from gepf.coordinator.sources.colour_folder import ColourFolder
from gepf.coordinator.sources.source import Source


def draw_run(
    source: Source,
    body: TrackedBody,
    track: Track,
    out: Path,
    truth: Truth | None = None,
    colours: ColourFolder | None = None,
    advance: Callable[[int, int], None] = lambda *_: None,
) -> list[Path]:
    """Write overlay.mp4, sheet.png and, if a body was found, hypotheses.png; returns the files.

    `body` is the tracked body with the degrees of freedom of the track. With `colours`, film and sheet are
    drawn over these images. The cameras of a rig are side by side. `advance` is called with the number of
    steps done and their total.
    """
    filmed = spread(len(track.frame), 200)
    on_sheet = {filmed[i] for i in spread(len(filmed), 15)}
    steps = len(filmed) + 1
    largest = DRAWING.finer * 480  # pixels, width and height of a picture
    views = {
        each.camera: view_around(track, each.intrinsics, largest, largest, inverse(each.T_rig_camera))
        for each in source.views
    }
    kept: list[Image.Image] = []

    def paint_all() -> Iterator[Image.Image]:
        for done, f in enumerate(filmed):
            advance(done, steps)
            number = int(track.frame[f])
            image = colours.frame(number) if colours else None
            picture = paint_views(source.frame(number), views, body.model, track, f, image)
            if f in on_sheet:
                kept.append(picture)
            yield picture

    files = [out / FILM_FILE, out / SHEET_FILE]
    write_film(paint_all(), size_of(views), track.time_s[filmed], files[0])
    save_png(tile(kept), files[1])
    advance(steps - 1, steps)
    if track.placed.any():
        files.append(out / HYPOTHESES_FILE)
        draw_hypotheses(track, body, truth, files[-1])
    advance(steps, steps)
    return files


def size_of(views: Mapping[str, Viewport]) -> tuple[int, int]:
    """Width and height of a picture of all cameras."""
    each, finer = views.values(), DRAWING.finer
    return sum(view.width // finer for view in each), max(view.height // finer for view in each)


def paint_views(
    frame: Frame,
    views: Mapping[str, Viewport],
    model: BodyModel,
    track: Track,
    f: int,
    first: Image.Image | None,
) -> Image.Image:
    """The pictures of all cameras side by side, with their faults; black for a camera without a frame.

    If given, the image `first` is drawn instead of the first camera's depth, for example one in colour.
    """
    picture, left, images = Image.new("RGB", size_of(views)), 0, {each.camera: each for each in frame.views}
    names = track.camera_names or ()
    faults = {} if track.camera_fault is None else dict(zip(names, track.camera_fault[f], strict=True))
    for camera, view in views.items():
        image, seen = first if left == 0 else None, images.get(camera)
        if image is None and seen is not None:
            image = shade_depth(seen.metres(), seen.intrinsics)
        if image is not None:
            note = f"{camera} {faults.get(camera, '')}".strip()
            picture.paste(paint(image, view, model, track, f, note), (left, 0))
        left += view.width // DRAWING.finer
    return picture
