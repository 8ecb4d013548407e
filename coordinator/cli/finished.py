"""The commands on a finished run: evaluate, export, pictures, view and report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coordinator.cli.surroundings import on_stderr
from coordinator.commands.console.loading import loading
from coordinator.commands.options.arguments import ExportOptions, PicturesOptions, Quiet, Run, ViewOptions
from coordinator.commands.options.grouped import grouped

PANEL = "Look, compare, export"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
def evaluate(
    runs: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of results of gepf track.")],
    truth: Annotated[
        Path | None,
        typer.Option(
            "--truth", metavar="FILE", help="Truth of the sequence (default: the one that came with it)."
        ),
    ] = None,
    *,
    csv: Annotated[
        bool, typer.Option("--csv", help="One line a run, with commas; several runs need this.")
    ] = False,
) -> None:
    """Compare runs with the truth; prints one JSON object, or with --csv a table."""
    from coordinator.commands.finished.evaluate import run_evaluate

    run_evaluate(runs, truth, as_csv=csv)


@app.command(rich_help_panel=PANEL)
@grouped
def export(options: ExportOptions, quiet: Quiet = False) -> None:
    """Write a run's angles and poses for other programs."""
    from coordinator.commands.finished.export import run_export

    run_export(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=PANEL)
@grouped
def pictures(options: PicturesOptions, quiet: Quiet = False) -> None:
    """Draw a run's pictures anew, into its folder."""
    show = on_stderr(quiet=quiet)
    with loading(show, f"drawing pictures of {options.run}; loading"):
        from coordinator.commands.finished.pictures import run_pictures

    run_pictures(options, show)


@app.command(rich_help_panel=PANEL)
@grouped
def view(options: ViewOptions, quiet: Quiet = False) -> None:
    """Show a run on a time line: points, model, hypotheses, residuals, angles, status."""
    from coordinator.commands.finished.view import run_view

    run_view(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=PANEL)
def report(
    run: Run,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Page to write (default: DIR/report.html).")
    ] = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write one HTML page about a run: animation, angles and how sure they are, timings, settings."""
    from coordinator.commands.finished.report import run_report

    run_report(run, out, on_stderr(quiet=quiet))
