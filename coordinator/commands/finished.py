"""What each command does with a finished run: draw, view, report."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common.errors import InputError
from coordinator.commands.console import ENDING, loading, noted_interrupts
from coordinator.commands.options import PicturesOptions
from coordinator.commands.progress import Show
from coordinator.results.configuration import GIVEN, PATH, PEOPLE
from coordinator.results.evaluation import Truth, read_truth
from coordinator.results.summary import people_in, read_summary
from coordinator.results.track import Track, TrackedBody, read_track, read_tracked_body
from coordinator.sources import Source, open_source
from coordinator.sources.camera import CameraOptions
from coordinator.sources.colour_folder import ColourFolder

logger = logging.getLogger(__name__)

COLOUR = "color"  # in the summary


def run_pictures(options: PicturesOptions, show: Show) -> None:
    """Draw a run's pictures anew. InputError for a folder without a run, or frames that are gone."""
    run = options.run
    track, summary = read_track(run), read_summary(run)
    source = find_sequence(run, options.sequence)
    if source is None:
        raise InputError(f"the frames of {run} are not where they were; say where with --sequence SEQ")
    colours = open_colours(options.color, summary, source, track)
    truth = read_truth(source.truth) if source.truth and PEOPLE not in summary else None
    files = draw_pictures(source, read_tracked_body(run), track, run, show, truth, colours)
    show.say(f"{len(files)} pictures are in {run}: {', '.join(file.name for file in files)}")


def open_colours(
    given: Path | None, summary: Mapping[str, Any], source: Source, track: Track
) -> ColourFolder | None:
    """Colour frames to draw over: as given, else those that the run was drawn over."""
    folder = given or (Path(summary[COLOUR]) if summary.get(COLOUR) else None)
    numbers = range(int(track.frame[0]), int(track.frame[-1]) + 1)
    return ColourFolder(folder, source.intrinsics, numbers) if folder else None


def draw_pictures(
    source: Source,
    body: TrackedBody,
    track: Track,
    out: Path,
    show: Show,
    truth: Truth | None,
    colours: ColourFolder | None,
) -> list[Path]:
    """Draw with a bar; an interrupt ends it at once, and the pictures before it stay as they were."""
    with noted_interrupts(*ENDING), show.steps("drawing pictures") as advance:
        from coordinator.pictures.run import draw_run

        return draw_run(source, body, track, out, truth, colours, advance)


def find_sequence(run: Path, moved_to: Path | None) -> Source | None:
    """The sequence that was tracked: as given, else where it was; None, with a warning, if it is gone."""
    if moved_to is not None:
        return open_source(moved_to)
    summary = read_summary(run)
    recorded, camera = summary.get(PATH), summary.get(GIVEN) or {}
    if recorded is not None and Path(recorded).exists():
        lens = camera.get("lens")
        return open_source(
            Path(recorded), CameraOptions(tuple(lens) if lens else None, camera.get("depth_scale"))
        )
    logger.warning("the sequence of this run is not where it was; --sequence SEQ shows its depth as well")
    return None


def run_report(run: Path, out: Path | None, show: Show) -> None:
    """Write the page. Raises InputError if the folder holds no finished run."""
    page = out or run / "report.html"
    if not people_in(run):
        read_track(run)
    with loading(show, f"writing {page}"):
        from coordinator.report import write_report
    write_report(run, page)
    show.say(f"the report is in {page}")
