"""Draws all pictures of a run into its folder."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image

from common.errors import InputError
from coordinator.files import ERRORS_FILE, FILM_FILE, HYPOTHESES_FILE, SHEET_FILE, write_atomically
from coordinator.pictures.film import spread, tile, write_film
from coordinator.pictures.overlay import FINER, paint, view_around
from coordinator.pictures.plots import draw_errors, draw_hypotheses
from coordinator.pictures.shading import shade_depth
from coordinator.results.evaluation import Truth
from coordinator.results.track import Track, TrackedBody, filled
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.source import Source

LARGEST_PX = 480  # width and height of a picture
FILM_FRAMES = 200  # evenly distributed in a longer run, which is also shown in real time
SHEET_FRAMES = 15

logger = logging.getLogger(__name__)


def draw_run(
    source: Source,
    body: TrackedBody,
    track: Track,
    out: Path,
    truth: Truth | None = None,
    colours: ColourFolder | None = None,
    advance: Callable[[int, int], None] = lambda *_: None,
) -> list[Path]:
    """Write overlay.mp4, sheet.png, hypotheses.png and, with truth, errors.png; returns the files.

    A run in which no body was found has only the first two.

    `body` is the tracked body with the degrees of freedom of the track. With `colours`, film and sheet are
    drawn over these images. `advance` is called with the number of steps done and their total.
    """
    filmed = spread(len(track.frame), FILM_FRAMES)
    on_sheet = {filmed[i] for i in spread(len(filmed), SHEET_FRAMES)}
    steps = len(filmed) + 1
    view = view_around(track, source.intrinsics, FINER * LARGEST_PX, FINER * LARGEST_PX)
    kept: list[Image.Image] = []

    def paint_all() -> Iterator[Image.Image]:
        for done, f in enumerate(filmed):
            advance(done, steps)
            number = int(track.frame[f])
            image = colours.frame(number) if colours else None
            picture = paint(
                image or shade_depth(source.frame(number).metres(), source.intrinsics),
                view,
                body.model,
                track,
                f,
            )
            if f in on_sheet:
                kept.append(picture)
            yield picture

    files = [out / FILM_FILE, out / SHEET_FILE]
    write_film(paint_all(), (view.width // FINER, view.height // FINER), track.time_s[filmed], files[0])
    write_atomically(files[1], lambda opened: tile(kept).save(opened, "PNG"))
    advance(steps - 1, steps)
    if track.placed.any():
        files.append(out / HYPOTHESES_FILE)
        draw_hypotheses(filled(track), body, truth, files[-1])
        if truth is not None:
            try:
                draw_errors(track, truth, out / ERRORS_FILE)
                files.append(out / ERRORS_FILE)
            except InputError as error:
                logger.warning("there is no picture of the errors: %s", error)
    advance(steps, steps)
    return files
