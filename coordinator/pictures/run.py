"""All pictures of a run, into its folder."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image

from common.body import BodyModel
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
from coordinator.results.evaluation import Truth, compare
from coordinator.results.track import Track, TrackedBody, filled
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.source import Source
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.certainty.certainty import FLAGGED

PICTURE_SIZE = (360, 400)  # at the most
ANIMATION_FRAMES, SHEET_FRAMES, SHEET_COLUMNS = 75, 15, 5
FILM_FRAMES = 200  # of a longer run evenly spread ones, in real time all the same
FINAL_STEPS = 2  # after the frames: animation and sheet, then curves

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

    Of a run that never found anybody there are no curves, which are the last two.

    `body` is what was tracked, with the track's degrees of freedom. Without OpenGL it is drawn as
    its vertices, and a warning says so. With `colours`, overlay and sheet are drawn over these.
    `advance` is called with the steps that are done and their number.
    """
    files = [out / ANIMATION_FILE, out / SHEET_FILE, out / FILM_FILE]
    chosen, filmed = (spread(len(track.frame), most) for most in (ANIMATION_FRAMES, FILM_FRAMES))
    steps = len(chosen) + len(filmed) + FINAL_STEPS
    view, fault = around(track, source.intrinsics, *PICTURE_SIZE), opengl_fault()
    if fault is not None:
        logger.warning("pictures show the body as dots: %s", fault)
    close = Scene(source, body.model, track, colours, view, fault is None)
    pictures = list(paint(close, chosen, lambda done: advance(done, steps)))
    write_animation(pictures, len(track.frame) / source.fps / len(chosen), files[0])
    wide = replace(close, view=whole_view(source.intrinsics), finer=1)
    film = paint(wide, filmed, lambda done: advance(len(chosen) + done, steps))
    write_film(film, (wide.view.width, wide.view.height), track.time_s[filmed], files[2])
    write_sheet(pictures, files[1])
    advance(steps - 1, steps)
    if track.placed.any():
        files.append(out / HYPOTHESES_FILE)
        draw_hypotheses(filled(track), body, truth, files[-1])
        if truth is not None and comparable(track, truth):
            files.append(out / ERRORS_FILE)
            draw_errors(track, truth, files[-1])
    advance(steps, steps)
    return files


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is painted, and the part of the image in which it is."""

    source: Source
    model: BodyModel
    track: Track
    colours: ColourFolder | None
    view: View
    opengl: bool
    finer: int = FINER  # times as fine as the picture, then averaged


def paint(
    scene: Scene, chosen: list[int], done: Callable[[int], None] = lambda _: None
) -> Iterator[Image.Image]:
    """Pictures of the track's frames at positions `chosen`; `done` is called with how many there are."""
    done(0)
    with closing(Painter(scene.model, scene.view, scene.opengl, scene.finer)) as painter:
        for count, f in enumerate(chosen, start=1):
            number = int(scene.track.frame[f])
            colour = scene.colours.frame(number) if scene.colours else None
            yield painter.paint(scene.source.frame(number), shown_at(scene.track, f), colour=colour)
            done(count)


def write_animation(pictures: list[Image.Image], seconds_each: float, file: Path) -> None:
    """Write all pictures as an animated GIF."""
    data = encode_gif(pictures, seconds_each)
    write_atomically(file, lambda opened: opened.write(data))


def write_sheet(pictures: list[Image.Image], file: Path) -> None:
    """Write some of the pictures side by side."""
    sheet = tile([pictures[i] for i in spread(len(pictures), SHEET_FRAMES)], SHEET_COLUMNS)
    write_atomically(file, lambda opened: sheet.save(opened, "PNG"))


def comparable(track: Track, truth: Truth) -> bool:
    """Whether track and truth share anything; else a warning."""
    try:
        compare(track, truth)
    except InputError as error:
        logger.warning("there is no picture of the errors: %s", error)
        return False
    return True


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
