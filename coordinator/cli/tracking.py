"""The commands that track: demo, track and fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coordinator.cli.surroundings import connect_of, on_stderr
from coordinator.commands.console.loading import loading
from coordinator.commands.exit_codes import DONE
from coordinator.commands.options.arguments import FitOptions, Quiet
from coordinator.commands.options.grouped import grouped
from coordinator.commands.options.track_arguments import TrackOptions

PANEL = "Track"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
def demo(
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the demo (default: gepf-demo).")
    ] = None,
    scene: Annotated[
        str, typer.Option(metavar="person|arm", help="People who move fast, or the paper's arm behind noise.")
    ] = "person",
    *,
    quiet: Quiet = False,
) -> None:
    """Track rendered sequences with one particle and with many: a table of errors, and pictures."""
    show = on_stderr(quiet=quiet)
    with loading(show, "rendering a scene and tracking it in two ways; loading"):
        from coordinator.commands.demo.run import run_demo

    run_demo(out, show, scene)


@app.command(rich_help_panel=PANEL)
@grouped
def track(context: typer.Context, options: TrackOptions) -> None:
    """Track a recorded sequence, or depth frames as they are published."""
    show = on_stderr(quiet=options.output.quiet)
    what = ", ".join(map(str, options.input.sequences))
    with loading(show, f"tracking {what} into {options.output.out}; loading"):
        from coordinator.commands.run import run_track

    code = run_track(options, show, connect_of(context))
    if code != DONE:
        raise typer.Exit(code)


@app.command(rich_help_panel=PANEL)
@grouped
def fit(context: typer.Context, options: FitOptions) -> None:
    """Measure a person in a few frames, for track --model: stature, girth and the lengths of limbs.

    Not for accuracy: arms come out 5 % short, and two people who were tracked
    by such files had 0.4 points fewer joints within 10 cm than without.
    """
    show = on_stderr(quiet=options.quiet)
    with loading(show, f"measuring who is in {options.sequence}; loading"):
        from coordinator.commands.fit import run_fit

    run_fit(options, show, connect_of(context))
