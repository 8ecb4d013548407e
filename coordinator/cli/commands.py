"""The commands of `gepf` and their options."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coordinator.commands.console import leave_processors, loading, say
from coordinator.commands.options import (
    CameraOptions,
    Force,
    Model,
    PicturesOptions,
    PublishOptions,
    Quiet,
    Recording,
    Run,
    SecurityOptions,
    SynthOptions,
    TrackOptions,
    ViewOptions,
    grouped,
)

if TYPE_CHECKING:
    from coordinator.commands.progress import Show

TRACK, SEQUENCES, HOSTS, FINISHED = "Track", "Sequences and bodies", "Many hosts", "Look, compare, export"

app = typer.Typer()
model_app = typer.Typer()


def on_stderr(*, quiet: bool = False) -> Show:
    """Progress on stderr, unless the user wants none."""
    from rich.console import Console

    from coordinator.commands.progress import Show

    return Show(Console(stderr=True, quiet=quiet))


@app.command(rich_help_panel=TRACK)
def demo(
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the demo (default: gepf-demo).")
    ] = None,
    scene: Annotated[
        str, typer.Option(metavar="person|arm", help="People who move fast, or the paper's arm with noise.")
    ] = "person",
    *,
    quiet: Quiet = False,
) -> None:
    """Track rendered sequences with one particle and with many; show errors and draw pictures."""
    show = on_stderr(quiet=quiet)
    show.say("rendering a scene and tracking it in two ways; loading")
    with loading():
        from coordinator.commands.demo import run_demo

    run_demo(out, show, scene)


@app.command(rich_help_panel=TRACK)
@grouped
def track(
    context: typer.Context, options: TrackOptions, camera: CameraOptions, security: SecurityOptions
) -> None:
    """Track a recorded sequence, or depth frames as they are published."""
    show = on_stderr(quiet=options.quiet)
    show.say(f"tracking {', '.join(map(str, options.sequences))} into {options.out}; loading")
    with loading():
        from coordinator.commands.track import run_track
        from coordinator.commands.workers import connect_workers
    code = run_track(options, camera, security, show, context.obj or connect_workers)
    raise typer.Exit(code)


@app.command(rich_help_panel=SEQUENCES)
@grouped
def info(
    sequence: Recording,
    camera: CameraOptions,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the detected floor, walls and people as PNG.")
    ] = None,
) -> None:
    """Show facts about a sequence and its scene: camera, depth, floor, walls, people; or about a run."""
    from coordinator.commands.info import run_info

    run_info(sequence, camera, picture, as_json=as_json)


@app.command(rich_help_panel=SEQUENCES)
def calibrate(
    context: typer.Context,
    sequences: Annotated[
        list[Path],
        typer.Argument(metavar="A B [C ...]", help="A recording of each camera, at the same time."),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE.json", help="Rig to write.")],
    given: Annotated[
        Path | None,
        typer.Option("--from", metavar="FILE|DIR", help="Places from Kalibr, ROS or 4 x 4 matrices instead."),
    ] = None,
    *,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find the places and clocks of cameras, from a person who moves in front of all of them."""
    show = on_stderr(quiet=quiet)
    show.say(f"calibrating {len(sequences)} cameras; loading")
    with loading():
        from coordinator.commands.calibrate import run_calibrate
        from coordinator.commands.workers import connect_workers
    run_calibrate(sequences, given, out, show, context.obj or connect_workers, force=force)


@app.command(rich_help_panel=SEQUENCES)
@grouped
def synth(options: SynthOptions, quiet: Quiet = False) -> None:
    """Render a sequence with ground truth and a start pose."""
    from coordinator.synthesis.sequence import synthesise

    with on_stderr(quiet=quiet).steps("rendering frame") as advance:
        synthesise(**asdict(options), advance=advance)


app.add_typer(model_app, name="model", rich_help_panel=SEQUENCES)


@model_app.callback(invoke_without_command=True)
def help_with_models(context: typer.Context) -> None:
    """Draw a body, or list its degrees of freedom."""
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
    from coordinator.files import require_new

    require_new(out, force=force)
    from coordinator.bodies.choice import choose_model, load_body
    from coordinator.pictures.portrait import draw_portrait

    draw_portrait(load_body(choose_model(model)), out)


@model_app.command()
def dofs(model: Model = "human") -> None:
    """List a body's degrees of freedom, for --dof and init.json."""
    from coordinator.bodies.human.dofs import HUMAN, HUMAN_DOFS

    names = HUMAN_DOFS
    if model != HUMAN:  # a person's are known without the body, which takes seconds to build
        from coordinator.bodies.choice import choose_model, load_body

        names = load_body(choose_model(model)).dof_names
    sys.stdout.write("".join(f"{name}\n" for name in names))


@app.command(rich_help_panel=HOSTS)
@grouped
def publish(
    options: PublishOptions, camera: CameraOptions, security: SecurityOptions, quiet: Quiet = False
) -> None:
    """Publish a camera, or a recorded sequence in real time, as input for gepf track zenoh:KEY."""
    from coordinator.commands.publish import run_publish

    run_publish(options, camera, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=HOSTS)
def certificates(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder; valid certificates in it are kept.")],
    workers: Annotated[
        str, typer.Option(metavar="N|NAME,...", help="Their number (worker-0, ...) or their names.")
    ] = "1",
    hosts: Annotated[
        str, typer.Option(metavar="HOST,...", help="Other hosts where a coordinator or router listens.")
    ] = "",
    days: Annotated[int, typer.Option(min=1, help="Days of validity.")] = 30,
    mount: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Path of the folder in a router's container.")
    ] = None,
) -> None:
    """Create certificates for an authority, coordinator, router and workers."""
    from coordinator.security.access import choose_names
    from coordinator.security.certificates import make_certificates

    named = tuple(host.strip() for host in hosts.split(",") if host.strip())
    new = make_certificates(out, choose_names(workers), named, days, mount)
    made = ", ".join(new) or "nothing, all certificates are valid"
    say("gepf", f"new in {out}: {made}; keep ca.key secret")


@app.command(rich_help_panel=HOSTS)
@grouped
def router(
    listen: Annotated[str, typer.Option(metavar="ENDPOINT", help="Where to listen, e.g. tls/0.0.0.0:7447.")],
    security: SecurityOptions,
    connect: Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Another router to join.")] = None,
) -> None:
    """Run a router between coordinators and workers until it is stopped."""
    import signal

    from common.transport.opening import open_router
    from common.transport.session import ROUTER

    secured = security.choose(listen, connect, holder=ROUTER)
    stop = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    with open_router([listen], [connect] if connect else [], secured):
        say("gepf", f"routing on {listen}")
        signal.sigwait(stop)


@app.command(rich_help_panel=FINISHED)
def evaluate(
    runs: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of results of gepf track.")],
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="FILE", help="Ground truth (default: the sequence's own)."),
    ] = None,
    *,
    csv: Annotated[
        bool, typer.Option("--csv", help="Print CSV, one line per run; required for several runs.")
    ] = False,
) -> None:
    """Compare runs with ground truth; prints one JSON object, or with --csv a table."""
    from coordinator.commands.evaluate import run_evaluate

    run_evaluate(runs, truth, as_csv=csv)


@app.command(rich_help_panel=FINISHED)
def export(
    run: Run,
    form: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="csv, mot, c3d, trc, bvh, glb, gltf or json.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")],
    smooth: Annotated[
        float | None, typer.Option(metavar="HZ", help="Low pass without delay, e.g. 6 (default: as tracked).")
    ] = None,
    *,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Write the angles and poses of a run for other programs."""
    from coordinator.exports import export_run

    track = export_run(run, form, out, smooth_hz=smooth, force=force).track
    gone = f", {lost} of them lost" if (lost := int(track.unknown.sum())) else ""
    low_pass = f", low pass {smooth:g} Hz" if smooth else ""
    kilobytes = out.stat().st_size / 1000
    on_stderr(quiet=quiet).say(
        f"{out}: {len(track.frame)} frames{gone}{low_pass}, {kilobytes:.0f} kB as {form}"
    )


@app.command(rich_help_panel=FINISHED)
@grouped
def pictures(options: PicturesOptions, quiet: Quiet = False) -> None:
    """Draw the pictures of a run again, into its folder."""
    with loading():
        from coordinator.commands.finished import run_pictures
    run_pictures(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=FINISHED)
@grouped
def view(options: ViewOptions, security: SecurityOptions, quiet: Quiet = False) -> None:
    """Show a run, or live input while it is tracked: points, model, hypotheses, residuals, angles, status."""
    if str(options.run).startswith("zenoh:"):
        leave_processors()  # even loading would slow down a tracker on this host
    from coordinator.commands.view import run_view

    run_view(options, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=FINISHED)
def report(
    run: Run,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Page to write (default: DIR/report.html).")
    ] = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write one HTML page about a run: animation, angles with deviations, timings, settings."""
    from coordinator.commands.finished import run_report

    run_report(run, out, on_stderr(quiet=quiet))
