"""The commands about sequences and bodies: init, info, synth and model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coordinator.cli import model
from coordinator.cli.surroundings import connect_of, on_stderr
from coordinator.commands.console.loading import loading
from coordinator.commands.options.arguments import CameraOptions, InitOptions, Quiet, Recording, SynthOptions
from coordinator.commands.options.grouped import grouped

PANEL = "Sequences and bodies"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
@grouped
def init(context: typer.Context, options: InitOptions) -> None:
    """Write a start file from joint values, drawn over the first frame and refined on it."""
    show = on_stderr(quiet=options.quiet)
    with loading(show, f"placing {options.model} in {options.sequence}; loading"):
        from coordinator.commands.init import run_init

    run_init(options, show, connect_of(context))


@app.command(rich_help_panel=PANEL)
@grouped
def info(
    sequence: Recording,
    camera: CameraOptions,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    thumbnail: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw a frame as PNG.")] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw floor, walls and people that are found as PNG.")
    ] = None,
) -> None:
    """Show what a sequence is, and what would be found in it: camera, depth, floor, walls, people."""
    from coordinator.commands.info import Pictures, run_info
    from coordinator.sources.camera import parse_camera_options

    given = parse_camera_options(camera.intrinsics, camera.depth_scale)
    run_info(sequence, given, Pictures(thumbnail, picture), as_json=as_json)


@app.command(rich_help_panel=PANEL)
@grouped
def synth(options: SynthOptions, quiet: Quiet = False) -> None:
    """Render a sequence with truth and the start it is meant to be tracked from."""
    from coordinator.commands.synth import run_synth

    run_synth(options, on_stderr(quiet=quiet))


app.add_typer(model.app, name="model", rich_help_panel=PANEL)
