"""The command `gepf`.

What another program would read goes to stdout, all else to stderr. Exit codes: 0 done, 2 the user's input
is at fault (one line on stderr), 1 anything else. What takes long to load is imported by the command that
needs it.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import GepfError, InputError

if TYPE_CHECKING:
    from coordinator.commands.progress import Show

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

INPUT, METHOD, WORKERS, SECURITY, OUTPUT = "Input", "Method", "Workers", "Security", "Output"
FORMATS = "Open3D or TUM folder, stereo pairs, PLY or PCD clouds, RealSense .bag, numpy .npz, UTD-MHAD .mat"

Model = Annotated[str, typer.Argument(metavar="human|FILE", help="Template, URDF, or a file of gepf fit.")]
Sequence_ = Annotated[Path, typer.Argument(metavar="SEQ", help=f"{FORMATS}.")]
Input = Annotated[
    Path,
    typer.Argument(metavar="SEQ", help=f"{FORMATS}; or zenoh:KEY for live input."),
]
Results = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="New folder for the results.", rich_help_panel=OUTPUT)
]
Listen = typer.Option(
    metavar="ENDPOINT", help="Let others' workers join, e.g. tls/0.0.0.0:7447.", rich_help_panel=WORKERS
)
TlsCa = Annotated[
    Path | None,
    typer.Option(
        "--tls-ca",
        metavar="FILE",
        help="Certificate of who signs all certificates.",
        rich_help_panel=SECURITY,
    ),
]
TlsCert = Annotated[
    Path | None,
    typer.Option("--tls-cert", metavar="FILE", help="Our own certificate.", rich_help_panel=SECURITY),
]
TlsKey = Annotated[
    Path | None,
    typer.Option("--tls-key", metavar="FILE", help="The certificate's key.", rich_help_panel=SECURITY),
]
Insecure = Annotated[
    bool,
    typer.Option(
        "--insecure",
        help="Listen without encryption, to whoever connects, on any network.",
        rich_help_panel=SECURITY,
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show no progress; errors stay.", rich_help_panel=OUTPUT)
]
Run = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results of gepf track.")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code."""
    logging.basicConfig(format="gepf: %(message)s", level=logging.WARNING)
    try:
        code = app(arguments, prog_name="gepf", standalone_mode=False)
    except InputError as error:
        return complain(error, INPUT_AT_FAULT)
    except typer.TyperException as error:
        return complain(error, error.exit_code, error.format_message())
    except GepfError as error:
        return complain(error, FAILED)
    except ModuleNotFoundError as error:
        mend = f"the package {error.name} is missing; pip install 'gepf[coordinator]'"
        return complain(error, FAILED, mend)
    except Exception as error:  # noqa: BLE001 whatever it is, a user is told in one line
        return complain(error, FAILED, f"{type(error).__name__}: {error} (gepf --debug shows where)")
    if code == 128 + signal.SIGINT:
        say("stopped")
    return code if isinstance(code, int) else DONE


def complain(error: Exception, code: int, message: str | None = None) -> int:
    """Tell of an error in one line, after its trace if debugging, and return the exit code."""
    if os.environ.get(DEBUG, "0") != "0":
        traceback.print_exception(error)
    say(str(error) if message is None else message)
    return code


def say(message: str) -> None:
    """One line on stderr."""
    sys.stderr.write(f"gepf: {' '.join(message.split())}\n")


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
) -> None:
    """Track a body through depth images, following many pose hypotheses at once.

    `gepf demo` shows what it does; `gepf track SEQ --out DIR` does it with your recording.
    """
    if debug:
        os.environ[DEBUG] = "1"
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
    else:
        from coordinator.commands.config_file import use_config

        use_config(context, config)


@app.command(rich_help_panel=TRACKING)
def demo(
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the demo (default: gepf-demo).")
    ] = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Track an arm behind heavy noise: a table of errors, and pictures."""
    from coordinator.commands.demo import run_demo
    from coordinator.commands.workers import connect_workers

    end_as_interrupted()
    run_demo(out, on_stderr(quiet=quiet), connect_workers)


@app.command(rich_help_panel=TRACKING)
def track(  # noqa: PLR0913 one parameter an option
    sequence: Input,
    out: Results,
    *,
    method: Annotated[
        str,
        typer.Option(
            help="gepf (many hypotheses), gradient (one), condensation or annealed.", rich_help_panel=METHOD
        ),
    ] = "gepf",
    preset: Annotated[
        str, typer.Option(help="default, or paper (its constants).", rich_help_panel=METHOD)
    ] = "default",
    particles: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Particles a frame; of annealed in each of its 10 layers.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(metavar="N", help="Observed points a frame, at most.", rich_help_panel=METHOD),
    ] = None,
    noise_depth: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="The camera's noise along depth (default: measured in the first frame).",
            rich_help_panel=METHOD,
        ),
    ] = None,
    noise_lateral: Annotated[
        float | None, typer.Option(metavar="M", help="And across it.", rich_help_panel=METHOD)
    ] = None,
    dof: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Move only these, hold the rest; joints: all but the root.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            metavar="human|FILE",
            help="Body to track: a URDF file, or one of gepf fit.",
            rich_help_panel=INPUT,
        ),
    ] = "human",
    init: Annotated[
        str | None,
        typer.Option(
            metavar="auto|FILE",
            help="Pose to start from (default: SEQ/init.json, else auto).",
            rich_help_panel=INPUT,
        ),
    ] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="A:B", help="From frame A to before frame B.", rich_help_panel=INPUT)
    ] = None,
    color: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Draw results over these colour frames.", rich_help_panel=INPUT),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(help="Of all randomness: the same seed gives the same bytes.", rich_help_panel=METHOD),
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Local workers (default: one per core); 0 for those of others.",
            rich_help_panel=WORKERS,
        ),
    ] = None,
    listen: Annotated[str | None, Listen] = None,
    connect: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT", help="Join a router where others' workers are.", rich_help_panel=WORKERS
        ),
    ] = None,
    worker_timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Give up after so long without any worker (default: wait).",
            rich_help_panel=WORKERS,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with the run in --out, if there is one.", rich_help_panel=OUTPUT
        ),
    ] = False,
    deadline: Annotated[
        float | None,
        typer.Option(
            metavar="MS",
            help="Do with the particles that are refined so long after a frame came.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    insecure: Insecure = False,
    quiet: Quiet = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the summary at the end, one JSON object.", rich_help_panel=OUTPUT),
    ] = False,
) -> None:
    """Track a recorded sequence, or depth frames as they are published."""
    from coordinator.bodies.choice import choose_model
    from coordinator.commands.options import (
        Job,
        choose_deadline,
        choose_dofs,
        choose_pool,
        choose_settings,
        tell_noise,
    )
    from coordinator.security.tls import TlsFiles, choose_security

    settings = choose_settings(method, preset, particles, points, seed)
    settings = tell_noise(settings, noise_depth, noise_lateral)
    security = choose_security(listen, connect, TlsFiles(tls_ca, tls_cert, tls_key), insecure=insecure)
    pool = choose_pool(workers, listen, connect, security, worker_timeout, choose_deadline(deadline, method))
    job = Job(
        sequence, out, settings, pool, choose_model(model), choose_dofs(dof), init, frames, resume, color
    )

    from coordinator.commands.track import track_sequence
    from coordinator.commands.track_live import track_stream
    from coordinator.commands.workers import connect_workers
    from coordinator.sources.live import live_key

    end_as_interrupted()
    if live_key(sequence) is None:
        track_sequence(job, on_stderr(quiet=quiet), connect_workers)
    else:
        track_stream(job, on_stderr(quiet=quiet), connect_workers)
    if as_json:
        from coordinator.results.summary import SUMMARY_FILE

        sys.stdout.write((out / SUMMARY_FILE).read_text(encoding="utf-8"))


@app.command(rich_help_panel=TRACKING)
def fit(
    sequence: Sequence_,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.json", help="Measures to write.")],
    *,
    init: Annotated[
        str | None,
        typer.Option(metavar="auto|FILE", help="Pose to start from (default: SEQ/init.json, else auto)."),
    ] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="A:B", help="Frames to track (default: the first 90).")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of all randomness.")] = 0,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Local workers (default: one per core).")
    ] = None,
    quiet: Quiet = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the measures, one JSON object.", rich_help_panel=OUTPUT)
    ] = False,
) -> None:
    """Measure a person in a few frames, for track --model: stature, girth and the lengths of limbs."""
    from coordinator.commands.fit import FitJob, fit_sequence
    from coordinator.commands.options import choose_pool, choose_settings
    from coordinator.commands.workers import connect_workers

    settings = choose_settings("gepf", "default", None, None, seed)
    end_as_interrupted()
    job = FitJob(sequence, out, settings, choose_pool(workers, None, None), init, frames)
    fit_sequence(job, on_stderr(quiet=quiet), connect_workers)
    if as_json:
        sys.stdout.write(out.read_text(encoding="utf-8"))


@app.command(rich_help_panel=HOSTS)
def publish(  # noqa: PLR0913 one parameter an option
    sequence: Sequence_,
    key: Annotated[str, typer.Option(metavar="KEY", help="Where, e.g. camera/depth.")],
    *,
    rate: Annotated[
        float | None, typer.Option(metavar="FPS", help="Frames per second (default: the sequence's own).")
    ] = None,
    frames: Annotated[str | None, typer.Option(metavar="A:B", help="From frame A to before frame B.")] = None,
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Let trackers connect, e.g. tcp/127.0.0.1:7448.")
    ] = None,
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Connect to a tracker's --listen, or a router.")
    ] = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    insecure: Insecure = False,
    quiet: Quiet = False,
) -> None:
    """Publish a recorded sequence in real time, as a camera would: input for gepf track zenoh:KEY."""
    from coordinator.commands.options import choose_pool
    from coordinator.commands.publish import Broadcast, publish_sequence
    from coordinator.security.tls import TlsFiles, choose_security

    security = choose_security(listen, connect, TlsFiles(tls_ca, tls_cert, tls_key), insecure=insecure)
    end_as_interrupted()
    reached = choose_pool(None, listen, connect, security)
    publish_sequence(Broadcast(sequence, key, reached, rate, frames), on_stderr(quiet=quiet))


@app.command(rich_help_panel=LOOKING)
def evaluate(
    run: Run,
    truth: Annotated[Path, typer.Option("--truth", metavar="FILE", help="Truth of the sequence, truth.npz.")],
) -> None:
    """Compare a run with the truth; prints one JSON object."""
    import msgspec

    from coordinator.results.evaluation import evaluate
    from coordinator.results.track import read_track
    from coordinator.results.truth import check_truth_of, read_truth

    check_truth_of(run, truth)
    result = evaluate(read_track(run), read_truth(truth))
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(result)).decode() + "\n")


@app.command(rich_help_panel=LOOKING)
def export(
    run: Run,
    form: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="bap, bvh, csv, glb, gltf, json or trc.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write.")],
) -> None:
    """Write a run's poses for other programs."""
    from coordinator.exports import export_run

    export_run(run, form, out)


@model_app.command()
def show(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.png", help="Picture to write.")],
    model: Model = "human",
) -> None:
    """Draw a body at rest from three sides."""
    from coordinator.bodies.choice import choose_model, read_model
    from coordinator.pictures.portrait import draw_portrait

    draw_portrait(read_model(choose_model(model)), out)


@model_app.callback(invoke_without_command=True)
def help_with_models(context: typer.Context) -> None:
    """Draw a body, name what moves it, or write it as URDF."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@model_app.command()
def dofs(model: Model = "human") -> None:
    """List a body's degrees of freedom, for --dof and init.json."""
    from coordinator.bodies.choice import choose_model, read_model

    sys.stdout.write("".join(f"{name}\n" for name in read_model(choose_model(model)).dof_names))


@model_app.command("export")
def export_model(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.urdf", help="File to write, meshes beside it.")],
    model: Model = "human",
) -> None:
    """Write a body as URDF, with a mesh for every link."""
    from coordinator.bodies.choice import choose_model, read_model
    from coordinator.bodies.urdf.writing import write_urdf

    write_urdf(read_model(choose_model(model)), out)


@app.command(rich_help_panel=LOOKING)
def view(
    run: Run,
    *,
    sequence: Annotated[
        Path | None, typer.Option(metavar="SEQ", help="Where the sequence is now, if it was moved.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a .rrd file for the rerun viewer instead.")
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65534, help="Of the viewer's page; the next one is used, too.")
    ] = 9090,
    browser: Annotated[bool, typer.Option(help="Open a browser here.")] = True,
    quiet: Quiet = False,
) -> None:
    """Show a run on a time line: points, model, hypotheses, residuals, angles, status."""
    from coordinator.commands.view import save_run, serve_run

    if save is not None:
        save_run(run, sequence, save, on_stderr(quiet=quiet))
        return
    serve_run(run, sequence, port, on_stderr(quiet=quiet), browser=browser)


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
    from coordinator.report import write_report

    page = out or run / "report.html"
    write_report(run, page)
    on_stderr(quiet=quiet).say(f"the report is in {page}")


@app.command(rich_help_panel=PREPARING)
def info(
    sequence: Sequence_,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    picture: Annotated[
        Path | None, typer.Option("--thumbnail", metavar="FILE", help="Draw a frame as PNG.")
    ] = None,
) -> None:
    """Say what a sequence is: format, frames, size, rate, camera, range of depth."""
    import msgspec

    from coordinator.commands.info import describe, thumbnail

    facts, middle = describe(sequence)
    if picture is not None:
        try:
            thumbnail(middle).save(picture, "PNG")
        except OSError as error:
            raise InputError(f"cannot write {picture}: {error.strerror}; choose another file") from error
    lines = "".join(f"{name:<12} {value}\n" for name, value in facts.items())
    sys.stdout.write(msgspec.json.encode(facts).decode() + "\n" if as_json else lines)
    if sys.stdout.isatty() and not as_json:
        from rich.console import Console

        from coordinator.pictures.blocks import in_blocks

        console = Console()
        console.print(in_blocks(thumbnail(middle), console.width))


@app.command(rich_help_panel=PREPARING)
def synth(  # noqa: PLR0913 one parameter an option
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="arm, turn, or roam with --model.")],
    out: Annotated[Path, typer.Option("--out", metavar="SEQ", help="New folder for the sequence.")],
    *,
    frames: Annotated[int | None, typer.Option(metavar="N", help="Only the first N frames.")] = None,
    noise_depth: Annotated[float, typer.Option(metavar="M", help="Standard deviation along depth.")] = 0.0,
    noise_lateral: Annotated[float, typer.Option(metavar="M", help="Standard deviation across.")] = 0.0,
    kinect: Annotated[
        bool, typer.Option("--kinect", help="Noise, steps and gaps as a Kinect has them.")
    ] = False,
    model: Annotated[
        str | None, typer.Option(metavar="human|FILE.urdf", help="Body that roams: all its joints move.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the noise, and of roaming.")] = 0,
    quiet: Quiet = False,
) -> None:
    """Render a sequence with truth and the start it is meant to be tracked from."""
    from coordinator.synthesis.sequence import synthesise

    with on_stderr(quiet=quiet).steps("rendering") as advance:
        synthesise(scene, out, frames, noise_depth, noise_lateral, seed, advance, model=model, kinect=kinect)


@app.command(rich_help_panel=HOSTS)
def certificates(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder; what is good in it stays.")],
    *,
    workers: Annotated[
        str, typer.Option(metavar="N|NAME,...", help="How many (worker-0 and so on), or their names.")
    ] = "1",
    hosts: Annotated[
        str, typer.Option(metavar="HOST,...", help="Where coordinator or router listen; this host is.")
    ] = "",
    days: Annotated[int, typer.Option(help="How long they last.")] = 30,
    mount: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where a router in a container sees the folder.")
    ] = None,
) -> None:
    """Make certificates for a trial: an authority, coordinator, router and workers."""
    from coordinator.commands.options import at_least
    from coordinator.security.certificates import make_certificates
    from coordinator.security.roster import choose_names

    at_least(1, "--days", days)
    listed = tuple(host.strip() for host in hosts.split(",") if host.strip())
    new = make_certificates(out, choose_names(workers), listed, days, mount)
    say(f"new in {out}: {', '.join(new) or 'nothing, all are there and good'}; keep ca.key to yourself")


@app.command(rich_help_panel=HOSTS)
def router(
    listen: Annotated[str, Listen],
    *,
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Another router to connect to.")
    ] = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    insecure: Insecure = False,
) -> None:
    """Let coordinators and workers meet, until stopped."""
    from common.transport.access import ROUTER
    from coordinator.commands.router import route
    from coordinator.security.tls import TlsFiles, choose_security

    files = TlsFiles(tls_ca, tls_cert, tls_key)
    route(listen, connect, choose_security(listen, connect, files, holder=ROUTER, insecure=insecure), say)


def end_as_interrupted() -> None:
    """Let SIGTERM end a run as Ctrl-C does, so that its frames are kept."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def on_stderr(*, quiet: bool = False) -> Show:
    """Progress for people, unless they want none."""
    from rich.console import Console

    from coordinator.commands.progress import show_on

    return show_on(Console(stderr=True, quiet=quiet))


if __name__ == "__main__":
    sys.exit(main())
