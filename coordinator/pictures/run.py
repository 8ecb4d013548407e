"""All pictures of a run, into its folder."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from PIL import Image

from common.camera import Intrinsics
from common.errors import GepfError, InputError
from coordinator.files import (
    ANIMATION_FILE,
    ERRORS_FILE,
    FILM_FILE,
    HYPOTHESES_FILE,
    SHEET_FILE,
    write_atomically,
)
from coordinator.pictures.film import encode_gif, spread, tile, whole_view, write_film
from coordinator.pictures.hypotheses import draw_hypotheses
from coordinator.pictures.overlay import FINER, Painter, Shown, View, around
from coordinator.pictures.plots import draw_errors
from coordinator.results.evaluation import Truth
from coordinator.results.track import Track, TrackedBody, filled
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.source import Source
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.certainty.certainty import FLAGGED

PICTURE_SIZE = (360, 400)  # at the most
ANIMATION_FRAMES, SHEET_FRAMES, SHEET_COLUMNS = 75, 15, 5
FILM_FRAMES = 200  # of a longer run evenly spread ones, in real time all the same

Advance = Callable[[int, int], None]

logger = logging.getLogger(__name__)


def draw_run(
    source: Source,
    body: TrackedBody,
    track: Track,
    out: Path,
    truth: Truth | None = None,
    colours: ColourFolder | None = None,
    advance: Advance = lambda *_: None,
) -> list[Path]:
    """Write overlay.gif and .mp4, sheet.png, hypotheses.png and, with truth, errors.png; returns the files.

    A run in which no body was found has no curves, which are the last two.

    `body` is what was tracked, with the track's degrees of freedom. Without OpenGL it is drawn as
    its vertices, and a warning says so. With `colours`, overlay and sheet are drawn over these.
    `advance` is called with the steps that are done and their number.
    """
    files = [out / ANIMATION_FILE, out / SHEET_FILE, out / FILM_FILE]
    chosen, filmed = (spread(len(track.frame), most) for most in (ANIMATION_FRAMES, FILM_FRAMES))
    steps = len(chosen) + len(filmed) + 2  # then animation and sheet, then curves
    fault, whole = opengl_fault(), whole_view(source.intrinsics)
    if fault is not None:
        logger.warning("pictures show the body as dots: %s", fault)

    def paint(view: View, finer: int, positions: list[int], done: int) -> Iterator[Image.Image]:
        with closing(Painter(body.model, view, fault is None, finer)) as painter:
            for count, f in enumerate(positions):
                advance(done + count, steps)
                number = int(track.frame[f])
                colour = colours.frame(number) if colours else None
                yield painter.paint(source.frame(number), shown_at(track, f), colour=colour)

    pictures = list(paint(around(track, source.intrinsics, *PICTURE_SIZE), FINER, chosen, 0))
    animation = encode_gif(pictures, len(track.frame) / source.fps / len(chosen))
    write_atomically(files[0], lambda opened: opened.write(animation))
    film = paint(whole, 1, filmed, len(chosen))
    write_film(film, (whole.width, whole.height), track.time_s[filmed], files[2])
    sheet = tile([pictures[i] for i in spread(len(pictures), SHEET_FRAMES)], SHEET_COLUMNS)
    write_atomically(files[1], lambda opened: sheet.save(opened, "PNG"))
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


def shown_at(track: Track, position: int) -> Shown:
    """What the tracker said about the frame at this position."""
    chance = track.joint_off_probability
    return Shown(
        track.pose[position],
        track.hypothesis_pose[position],
        track.hypothesis_weight[position],
        str(track.status[position]),
        None if chance is None else chance[position] > FLAGGED,
    )


def opengl_fault() -> GepfError | None:
    """Why surfaces cannot be rendered; None if they can."""
    try:
        DepthRenderer(Intrinsics(8, 8, 8.0, 8.0, 3.5, 3.5)).close()
    except GepfError as error:
        return error
    return None
