"""Pictures and report of a finished run; finds its sequence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gepf.common.errors import InputError
from gepf.coordinator.commands.console import loading
from gepf.coordinator.commands.options import PicturesOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.files import HYPOTHESES_FILE
from gepf.coordinator.results.configuration import CAMERA_GIVEN, PATH, PEOPLE
from gepf.coordinator.results.evaluation import Truth, read_truth
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.summary import find_summary, read_summary
from gepf.coordinator.results.track import Track, read_track, read_tracked_body
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.sources.camera import GivenCamera
from gepf.coordinator.sources.colour_folder import ColourFolder


def run_pictures(options: PicturesOptions, show: Show) -> None:
    """Draw the pictures of a run again. InputError for a folder without a run, or missing frames."""
    run = options.run
    finish_killed(run)
    track, summary = read_track(run), read_summary(run)
    source = find_sequence(run, options.sequence)
    if source is None:
        raise InputError(f"the frames of {run} were moved; give their path with --sequence SEQ")
    folder = options.color or summary.get("color")
    numbers = range(int(track.frame[0]), int(track.frame[-1]) + 1)
    colours = None
    if folder:
        mirrored = bool(source.mirrored)
        colours = ColourFolder(Path(folder), source.intrinsics, numbers, mirrored=mirrored)
    truth = own_truth(run, source)
    known = read_truth(truth, source.T_rig_camera) if truth else None
    files = draw_pictures(track, source, run, show, known, colours)
    show.say(f"{len(files)} pictures are in {run}: {', '.join(file.name for file in files)}")


def draw_pictures(
    track: Track,
    source: Source | None,
    out: Path,
    show: Show,
    truth: Truth | None,
    colours: ColourFolder | None,
) -> list[Path]:
    """Draw a run with a progress bar; without its sequence, as for live input, only the hypotheses."""
    body = read_tracked_body(out)
    with show.steps("drawing pictures") as advance:
        if source is None:
            from gepf.coordinator.pictures.plots import draw_hypotheses

            draw_hypotheses(track, body, None, out / HYPOTHESES_FILE)
            return [out / HYPOTHESES_FILE]
        from gepf.coordinator.pictures.run import draw_run

        return draw_run(source, body, track, out, truth, colours, advance)


def find_sequence(run: Path, moved_to: Path | None = None) -> Source | None:
    """The tracked sequence: at `moved_to` if given, else at its recorded path; None if that is missing."""
    if moved_to is not None:
        return open_source(moved_to, camera_in(find_summary(run) or {}))
    summary = read_summary(run)
    recorded = summary.get(PATH)
    return open_source(recorded, camera_in(summary)) if recorded and Path(recorded).exists() else None


def camera_in(summary: Mapping[str, Any]) -> GivenCamera:
    """The camera options that the user gave when a run was tracked."""
    given = summary.get(CAMERA_GIVEN) or {}
    lens = given.get("lens")
    return GivenCamera(tuple(lens) if lens else None, given.get("depth_scale"), given.get("mirrored"))


def own_truth(run: Path, source: Source | None) -> Path | None:
    """The truth of a run's sequence; None with several people, as the truth does not say whose it is."""
    return None if source is None or PEOPLE in read_summary(run) else source.truth


def run_report(run: Path, out: Path | None, show: Show) -> None:
    """Write the report. Raises InputError if the folder holds no finished run."""
    finish_killed(run)
    page = out or run / "report.html"
    with loading():
        from gepf.coordinator.report.page import write_report
    write_report(run, page)
    show.say(f"the report is in {page}")
