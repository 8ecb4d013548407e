"""The commands of `gepf`."""

from __future__ import annotations

import inspect
import math
import os
import sys
from collections.abc import Callable
from dataclasses import asdict, fields, is_dataclass
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from gepf.common.errors import InputError
from gepf.common.packages import needs
from gepf.coordinator.commands import options as given
from gepf.coordinator.commands.console import loading, say
from gepf.coordinator.commands.options import CameraOptions, Quiet, SecurityOptions


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer, with the fields of the dataclasses that are the parameters of `command`.

    Names of fields must differ within a command. Every option that is a quantity must be above zero.
    """
    kinds = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in kinds.items() if is_dataclass(kind)}
    flat = list[inspect.Parameter]()
    for name, parameter in inspect.signature(command).parameters.items():
        single = parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=kinds[name])
        flat += parameters_of(kinds[name]) if name in groups else [single]

    def run(**values: Any) -> None:
        for name, value in values.items():
            if isinstance(value, float) and not 0.0 < value < math.inf:
                raise InputError(f"--{name.replace('_', '-')} {value:g} is not valid; give a number above 0")
        built = {
            name: make(**{field.name: values.pop(field.name) for field in fields(make)})
            for name, make in groups.items()
        }
        command(**built, **values)

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run


def parameters_of(kind: Any) -> list[inspect.Parameter]:
    """A parameter for each field of a dataclass."""
    types = get_type_hints(kind, include_extras=True)
    for each in fields(kind):
        if "typer" in each.metadata:
            types[each.name] = Annotated[types[each.name], each.metadata["typer"]]
    return [one.replace(annotation=types[one.name]) for one in inspect.signature(kind).parameters.values()]


if TYPE_CHECKING:
    from gepf.coordinator.commands.progress import Show

TRACK, SEQUENCES, HOSTS, FINISHED = "Track", "Sequences and bodies", "Many hosts", "Look, compare, export"

app = typer.Typer()
model_app = typer.Typer(help="List degrees of freedom.")


def on_stderr(*, quiet: bool = False) -> Show:
    """Progress on stderr, unless the user wants none."""
    from rich.console import Console

    from gepf.coordinator.commands.progress import Show

    return Show(Console(stderr=True, quiet=quiet))


@app.command(rich_help_panel=TRACK)
@grouped
def demo(options: given.DemoOptions, quiet: Quiet = False) -> None:
    """Track rendered sequences with one particle and with many; show errors and draw pictures."""
    show = on_stderr(quiet=quiet)
    show.say("rendering a scene and tracking it in two ways; loading")
    with needs("synth", "gepf demo"):
        with loading():
            from gepf.coordinator.commands.demo import run_demo
        run_demo(options.out, show, options.scene)


@app.command(rich_help_panel=TRACK)
@grouped
def track(
    context: typer.Context, options: given.TrackOptions, camera: CameraOptions, security: SecurityOptions
) -> None:
    """Track a recorded sequence, or depth frames as they are published."""
    show = on_stderr(quiet=options.quiet)
    into = "" if options.out is None else f" into {options.out}"
    inputs = ", ".join(map(str, options.sequences or [])) or options.listed or "nothing"
    show.say(f"tracking {inputs}{into}; loading")
    with loading():
        from gepf.coordinator.commands.runs import run_track
        from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
    code = run_track(options, camera, security, show, context.obj or ZenohRefiner)
    raise typer.Exit(code)


@app.command(rich_help_panel=SEQUENCES)
@grouped
def info(options: given.InfoOptions, camera: CameraOptions) -> None:
    """Show facts about a sequence and its scene: camera, depth, floor, walls, people; or about a run."""
    from gepf.coordinator.commands.info import run_info

    run_info(options, camera)


@app.command(rich_help_panel=SEQUENCES)
@grouped
def calibrate(context: typer.Context, options: given.CalibrateOptions, quiet: Quiet = False) -> None:
    """Find the poses and clocks of cameras, from a person who moves in front of all of them."""
    show = on_stderr(quiet=quiet)
    show.say(f"calibrating {len(options.sequences)} cameras; loading")
    with loading():
        from gepf.coordinator.commands.calibrate import run_calibrate
        from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
    run_calibrate(options, show, context.obj or ZenohRefiner)


@app.command(rich_help_panel=SEQUENCES)
@grouped
def synth(options: given.SynthOptions, quiet: Quiet = False) -> None:
    """Render a sequence with ground truth and, unless the person is to be detected, a start pose."""
    with needs("synth", "gepf synth"):
        from gepf.coordinator.synthesis.sequence import synthesise

    with on_stderr(quiet=quiet).steps("rendering frame") as advance:
        synthesise(**asdict(options), advance=advance)


app.add_typer(model_app, name="model", rich_help_panel=SEQUENCES)


@model_app.command()
def dofs(model: given.Body = "human") -> None:
    """List a body's degrees of freedom, for --dof and init.json."""
    from gepf.coordinator.bodies.human.dofs import HUMAN, HUMAN_DOFS

    names = HUMAN_DOFS
    if model != HUMAN:  # a person's are known without the body, which takes seconds to build
        from gepf.coordinator.bodies.choice import choose_model, load_body

        names = load_body(choose_model(model)).dof_names
    sys.stdout.write("".join(f"{name}\n" for name in names))


@app.command(rich_help_panel=HOSTS)
@grouped
def publish(
    options: given.PublishOptions, camera: CameraOptions, security: SecurityOptions, quiet: Quiet = False
) -> None:
    """Publish a camera, or a recorded sequence in real time, as input for gepf track zenoh:KEY."""
    from gepf.coordinator.commands.publish import run_publish

    run_publish(options, camera, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=HOSTS)
@grouped
def certificates(options: given.CertificatesOptions) -> None:
    """Create or renew the certificates of an authority, coordinators, a router and workers."""
    from gepf.common.protocol.keys import check_name
    from gepf.coordinator.security.access import choose_names
    from gepf.coordinator.security.certificates import make_certificates

    hosts = tuple(host.strip() for host in options.hosts.split(",") if host.strip())
    names = [name.strip() for name in options.coordinators.split(",") if name.strip()]
    coordinators = tuple(check_name("coordinator", name) for name in names)
    made = make_certificates(
        options.out, choose_names(options.workers), hosts, options.days, options.mount, coordinators
    )
    new = ", ".join(made.new) or "nothing, as no certificate needs renewal yet"
    say("gepf", f"new in {options.out}: {new}; keep ca.key secret")
    if made.succession is not None:
        say("gepf", made.succession)
    say("gepf", f"to renew the certificates, run the same command again from {made.renew_from:%Y-%m-%d} on")


@app.command(rich_help_panel=HOSTS)
@grouped
def router(options: given.RouterOptions, security: SecurityOptions) -> None:
    """Run a router between coordinators and workers until it is stopped."""
    import signal

    from gepf.common.transport.opening import open_router
    from gepf.common.transport.session import ROUTER

    secured = security.choose(options.listen, options.connect, holder=ROUTER)
    stop = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    with open_router([options.listen], [options.connect] if options.connect else [], secured):
        say("gepf", f"routing on {options.listen}")
        signal.sigwait(stop)


@app.command(rich_help_panel=FINISHED)
@grouped
def evaluate(options: given.EvaluateOptions) -> None:
    """Compare runs with ground truth; prints one JSON object, or with --csv a table."""
    from gepf.coordinator.commands.evaluate import run_evaluate

    run_evaluate(options)


@app.command(rich_help_panel=FINISHED)
@grouped
def export(options: given.ExportOptions, quiet: Quiet = False) -> None:
    """Write the angles and poses of a run for other programs."""
    from gepf.coordinator.exports import export_run

    out, form, smooth = options.out, options.form, options.smooth
    track = export_run(
        options.run, form, out, frame=options.frame, smooth_hz=smooth, force=options.force
    ).track
    count = len(track.frame)
    frames = f"{count} frames" if count > 1 else f"frame {track.frame[0]}"
    gone = f", {lost} of them lost" if (lost := int(track.unknown.sum())) else ""
    low_pass = f", low pass {smooth:g} Hz" if smooth else ""
    kilobytes = out.stat().st_size / 1000
    on_stderr(quiet=quiet).say(f"{out}: {frames}{gone}{low_pass}, {kilobytes:.0f} kB as {form}")


@app.command(rich_help_panel=FINISHED)
@grouped
def pictures(options: given.PicturesOptions, quiet: Quiet = False) -> None:
    """Draw the pictures of a run again, into its folder."""
    with loading():
        from gepf.coordinator.commands.finished import run_pictures
    run_pictures(options, on_stderr(quiet=quiet))


@app.command(rich_help_panel=FINISHED)
@grouped
def view(options: given.ViewOptions, security: SecurityOptions, quiet: Quiet = False) -> None:
    """Show a run, or live input while it is tracked: depth, model, hypotheses, angles, status."""
    if str(options.run).startswith("zenoh:"):
        # use the processor only while it is idle: even loading would slow down a tracker on this host
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    with needs("view", "gepf view"):
        from gepf.coordinator.commands.view import run_view

    run_view(options, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=FINISHED)
@grouped
def report(options: given.ReportOptions, quiet: Quiet = False) -> None:
    """Write one HTML page about a run: animation, angles with deviations, timings, settings."""
    from gepf.coordinator.commands.finished import run_report

    run_report(options.run, options.out, on_stderr(quiet=quiet))
