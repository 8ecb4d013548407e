"""The command `gepf`.

What another program would read goes to stdout, all else to stderr. Exit codes: 0 done, 2 the user's input
is at fault (one line on stderr), 3 done, but most frames were not tracked, 130 interrupted, 1 anything
else. What takes long to load is imported by the command that needs it.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import GepfError, InputError
from coordinator.commands.console.loading import loading
from coordinator.commands.options.arguments import (
    CameraOptions,
    CertificateOptions,
    ExportOptions,
    FitOptions,
    Force,
    InitOptions,
    Model,
    PicturesOptions,
    PublishOptions,
    Quiet,
    Recording,
    RouterOptions,
    Run,
    SecurityOptions,
    SynthOptions,
    ViewOptions,
)
from coordinator.commands.options.grouped import grouped
from coordinator.commands.options.misuse import describe_misuse
from coordinator.commands.options.track_arguments import TrackOptions

if TYPE_CHECKING:
    from coordinator.commands.console.progress import Show
    from coordinator.commands.workers import Connect

DONE, FAILED, INPUT_AT_FAULT = 0, 1, 2
DEBUG = "GEPF_DEBUG"

TRACKING, LOOKING, PREPARING, HOSTS = "Track", "Look, compare, export", "Sequences and bodies", "Many hosts"
EXAMPLES = """A first run:

gepf info recording/

gepf track recording/ --out run/

gepf report run/

Options that are always the same can stand in gepf.toml, in a table for each command.
"""

app = typer.Typer(epilog=EXAMPLES)

model_app = typer.Typer()
app.add_typer(model_app, name="model", rich_help_panel=PREPARING)


def main(arguments: Sequence[str] | None = None, connect: Connect[Any] | None = None) -> int:
    """Run a command line and return its exit code. `connect` opens another pool than that of workers."""
    logging.basicConfig(format="gepf: %(message)s", level=logging.WARNING)
    try:
        code = app(arguments, prog_name="gepf", standalone_mode=False, obj=connect)
    except InputError as error:
        return complain(error, INPUT_AT_FAULT)
    except typer.TyperException as error:
        return complain(error, error.exit_code, describe_misuse(error))
    except GepfError as error:
        return complain(error, FAILED)
    except ModuleNotFoundError as error:
        mend = f"the package {error.name} is missing; pip install 'gepf[coordinator]'"
        return complain(error, FAILED, mend)
    except Exception as error:  # noqa: BLE001 whatever it is, a user reads one line
        return complain(error, FAILED, f"{type(error).__name__}: {error} (gepf --debug shows where)")
    if code == 128 + signal.SIGINT:
        say("stopped")
    return code if isinstance(code, int) else DONE


def complain(error: Exception, code: int, message: str | None = None) -> int:
    """Report an error in one line, after its trace if debugging, and return the exit code."""
    if os.environ.get(DEBUG, "0") != "0":
        traceback.print_exception(error)
    say(str(error) if message is None else message)
    return code


def say(message: str) -> None:
    """Write one line to stderr."""
    sys.stderr.write(f"gepf: {' '.join(message.split())}\n")


def on_stderr(*, quiet: bool = False) -> Show:
    """Progress for people, unless they want none."""
    from rich.console import Console

    from coordinator.commands.console.progress import show_on

    return show_on(Console(stderr=True, quiet=quiet))


def connect_of(context: typer.Context) -> Connect[Any]:
    """How a command reaches workers: as `main` was given, else over the bus."""
    from coordinator.commands import workers

    return context.obj or workers.connect_workers


@app.callback(invoke_without_command=True)
def gepf(
    context: typer.Context,
    *,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Options of the commands (default: gepf.toml, if it is here)."),
    ] = None,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show where an error arose; so does GEPF_DEBUG=1.")
    ] = False,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Track a body through depth images, following many pose hypotheses at once.

    `gepf demo` shows what it does; `gepf track SEQ --out DIR` does it with your recording.
    """
    if debug:
        os.environ[DEBUG] = "1"
    if version:
        from importlib import metadata

        typer.echo(f"gepf {metadata.version('gepf')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
    else:
        from coordinator.commands.options.config_file import use_config

        use_config(context, config)


@app.command(rich_help_panel=TRACKING)
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


@app.command(rich_help_panel=TRACKING)
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


@app.command(rich_help_panel=TRACKING)
@grouped
def fit(context: typer.Context, options: FitOptions) -> None:
    """Measure a person in a few frames, for track --model: stature, girth and the lengths of limbs."""
    show = on_stderr(quiet=options.quiet)
    with loading(show, f"measuring who is in {options.sequence}; loading"):
        from coordinator.commands.fit import run_fit

    run_fit(options, show, connect_of(context))


@app.command(rich_help_panel=PREPARING)
@grouped
def init(context: typer.Context, options: InitOptions) -> None:
    """Write a start file from joint values, drawn over the first frame and refined on it."""
    show = on_stderr(quiet=options.quiet)
    with loading(show, f"placing {options.model} in {options.sequence}; loading"):
        from coordinator.commands.init import run_init

    run_init(options, show, connect_of(context))


@app.command(rich_help_panel=HOSTS)
@grouped
def publish(options: PublishOptions, security: SecurityOptions, quiet: Quiet = False) -> None:
    """Publish a recorded sequence in real time, as a camera would: input for gepf track zenoh:KEY."""
    from coordinator.commands.publish import run_publish

    run_publish(options, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=LOOKING)
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


@app.command(rich_help_panel=LOOKING)
@grouped
def export(options: ExportOptions, quiet: Quiet = False) -> None:
    """Write a run's angles and poses for other programs."""
    from coordinator.commands.finished.export import run_export

    run_export(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=LOOKING)
@grouped
def pictures(options: PicturesOptions, quiet: Quiet = False) -> None:
    """Draw a run's pictures anew, into its folder."""
    show = on_stderr(quiet=quiet)
    with loading(show, f"drawing pictures of {options.run}; loading"):
        from coordinator.commands.finished.pictures import run_pictures

    run_pictures(options, show)


@model_app.callback(invoke_without_command=True)
def help_with_models(context: typer.Context) -> None:
    """Draw a body, name what moves it, or write it as URDF."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@model_app.command()
def show(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.png", help="Picture to write.")],
    model: Model = "human",
    *,
    force: Force = False,
) -> None:
    """Draw a body at rest from three sides."""
    from coordinator.commands.model import draw_model

    draw_model(model, out, force=force)


@model_app.command()
def dofs(model: Model = "human") -> None:
    """List a body's degrees of freedom, for --dof and init.json."""
    from coordinator.commands.model import list_dofs

    list_dofs(model)


@model_app.command("export")
def export_model(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.urdf", help="File to write, meshes beside it.")],
    model: Model = "human",
    *,
    force: Force = False,
) -> None:
    """Write a body as URDF, with a mesh for every link."""
    from coordinator.commands.model import write_as_urdf

    write_as_urdf(model, out, force=force)


@app.command(rich_help_panel=LOOKING)
@grouped
def view(options: ViewOptions, quiet: Quiet = False) -> None:
    """Show a run on a time line: points, model, hypotheses, residuals, angles, status."""
    from coordinator.commands.finished.view import run_view

    run_view(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=LOOKING)
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


@app.command(rich_help_panel=PREPARING)
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
    from coordinator.sources.given import parse_given

    given = parse_given(camera.intrinsics, camera.depth_scale)
    run_info(sequence, given, Pictures(thumbnail, picture), as_json=as_json)


@app.command(rich_help_panel=PREPARING)
@grouped
def synth(options: SynthOptions, quiet: Quiet = False) -> None:
    """Render a sequence with truth and the start it is meant to be tracked from."""
    from coordinator.commands.synth import run_synth

    run_synth(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=HOSTS)
@grouped
def certificates(options: CertificateOptions) -> None:
    """Make certificates for a trial: an authority, coordinator, router and workers."""
    from coordinator.commands.certificates import run_certificates

    run_certificates(options, say)


@app.command(rich_help_panel=HOSTS)
@grouped
def router(options: RouterOptions, security: SecurityOptions) -> None:
    """Let coordinators and workers meet, until stopped."""
    from coordinator.commands.router import run_router

    run_router(options, security, say)


if __name__ == "__main__":
    sys.exit(main())
