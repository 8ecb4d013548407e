"""The arguments and options of the commands: each is described once, as a field of a dataclass.

`grouped` makes parameters of typer from these fields. Every option that is a quantity is above zero.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from common.errors import InputError

if TYPE_CHECKING:
    from common.transport.session import Security

security_option = partial(typer.Option, rich_help_panel="Security")
input_option = partial(typer.Option, rich_help_panel="Input")
scene_option = partial(typer.Option, rich_help_panel="Scene")
method_option = partial(typer.Option, rich_help_panel="Method")
worker_option = partial(typer.Option, rich_help_panel="Workers")
output_option = partial(typer.Option, rich_help_panel="Output")


def seed_range(text: str) -> range:
    """Seeds A to before B of `A:B`."""
    first, colon, end = text.partition(":")
    if not colon or not first.isdecimal() or not end.isdecimal() or int(first) >= int(end):
        raise typer.BadParameter(f"'{text}' is not of the form A:B; 0:5 stands for 0, 1, 2, 3 and 4")
    return range(int(first), int(end))


Model = Annotated[str, typer.Argument(metavar="human|FILE", help="Template, URDF, or a person's measures.")]
Recording = Annotated[Path, typer.Argument(metavar="SEQ", help="Recorded depth (docs/formats.md).")]
Run = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results of gepf track.")]
Force = Annotated[bool, typer.Option("--force", help="Replace FILE if it is there.")]
Quiet = Annotated[bool, output_option("--quiet", "-q", help="Show no progress; errors stay.")]
Frames = Annotated[str | None, input_option(metavar="A:B", help="From frame A to before frame B.")]
Moved = Annotated[
    Path | None, typer.Option("--sequence", metavar="SEQ", help="Where the sequence is now, if it was moved.")
]
Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="SEQ...",
        help="Recorded depth (docs/formats.md), or zenoh:KEY for live input. "
        "Several recordings, or a .txt file with one per line, share the workers.",
    ),
]


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """What a recording does not say of its camera, or says wrongly."""

    intrinsics: Annotated[
        str | None, typer.Option(metavar="fx,fy,cx,cy", help="The camera, pixels (default: as recorded).")
    ] = None
    depth_scale: Annotated[
        float | None,
        typer.Option(metavar="N", help="Units of depth per metre (default: as recorded)."),
    ] = None


@dataclass(frozen=True, slots=True)
class SecurityOptions:
    """How connections are protected."""

    tls_ca: Annotated[
        Path | None, security_option(metavar="FILE", help="Certificate of who signs all certificates.")
    ] = None
    tls_cert: Annotated[Path | None, security_option(metavar="FILE", help="Our own certificate.")] = None
    tls_key: Annotated[Path | None, security_option(metavar="FILE", help="The certificate's key.")] = None
    insecure: Annotated[
        bool,
        security_option("--insecure", help="Listen without encryption, to whoever connects, on any network."),
    ] = False

    def choose(self, listen: str | None, connect: str | None, **holder: str) -> Security | None:
        """Certificate and access rules for these endpoints; InputError where they do not fit together."""
        from coordinator.security.access import TlsFiles, choose_security

        files = TlsFiles(self.tls_ca, self.tls_cert, self.tls_key)
        return choose_security(listen, connect, files, insecure=self.insecure, **holder)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOptions:
    """All options of `gepf track` but those of camera and security: input, scene, method, workers, output."""

    sequences: Recordings
    dof: Annotated[
        str | None,
        input_option(metavar="NAME,...", help="Move only these, hold the rest; joints: all but the root."),
    ] = None
    model: Annotated[
        str, input_option(metavar="human|FILE", help="Body to track: a URDF file, or a file of measures.")
    ] = "human"
    init: Annotated[
        str | None,
        input_option(metavar="auto|FILE", help="Pose to start from (default: SEQ/init.json, else auto)."),
    ] = None
    joint_states: Annotated[
        Path | None,
        input_option(
            metavar="FILE",
            help="What encoders say of the joints, a CSV with time_s or a ROS bag: where particles go.",
        ),
    ] = None
    frames: Frames = None
    idle_timeout: Annotated[
        float | None,
        input_option(
            metavar="SECONDS", help="Live input is over after so long without a frame (default: wait)."
        ),
    ] = None
    rotate: Annotated[
        str,
        input_option(
            metavar="0|90|180|270|auto",
            help="Degrees clockwise that turn the picture upright (default: found).",
        ),
    ] = "auto"
    color: Annotated[
        Path | None, input_option(metavar="DIR", help="Draw results over these colour frames.")
    ] = None
    person: Annotated[
        str,
        scene_option(
            metavar="X,Y|nearest|largest|moving",
            help="Who is tracked, of several: at a pixel of the first frame, or so (default: the likeliest).",
        ),
    ] = "best"
    people: Annotated[
        int,
        scene_option(
            metavar="N",
            min=1,
            help="Track up to so many people at once, each into a folder of its own in --out: person1, ...",
        ),
    ] = 1
    background: Annotated[
        str | None,
        scene_option(
            metavar="FRAME|SEQ",
            help="The room without anybody: a frame's number, a depth PNG, or a sequence.",
        ),
    ] = None
    near: Annotated[float | None, scene_option(metavar="M", help="Nothing nearer counts, metres.")] = None
    far: Annotated[float | None, scene_option(metavar="M", help="Nothing farther counts, metres.")] = None
    roi: Annotated[
        str | None,
        scene_option(metavar="LEFT,TOP,RIGHT,BOTTOM", help="Only this part of the picture counts, pixels."),
    ] = None
    method: Annotated[
        str, method_option(help="gepf (many hypotheses), gradient (one), condensation or annealed.")
    ] = "gepf"
    preset: Annotated[str, method_option(help="default, or paper (its constants).")] = "default"
    particles: Annotated[
        int | None,
        method_option(metavar="N", min=1, help="Particles a frame; of annealed in each of its 10 layers."),
    ] = None
    points: Annotated[int | None, method_option(metavar="N", min=1, help="Observed points, at most.")] = None
    noise_depth: Annotated[
        float | None,
        method_option(
            metavar="M", help="The camera's noise along depth (default: measured in the first frame)."
        ),
    ] = None
    noise_lateral: Annotated[float | None, method_option(metavar="M", help="And across it.")] = None
    seed: Annotated[
        int,
        method_option(min=0, max=2**32 - 1, help="Of all random numbers: the same gives the same bytes."),
    ] = 0
    seeds: Annotated[
        range | None,
        method_option(
            metavar="A:B",
            parser=seed_range,
            help="Track with each of the seeds A to before B, in folders within --out.",
        ),
    ] = None
    deadline: Annotated[
        float | None,
        method_option(
            metavar="MS", help="Finish a frame with the particles that are refined this long after it came."
        ),
    ] = None
    workers: Annotated[
        int | None,
        worker_option(
            metavar="N", min=0, help="Lanes of the local worker (default: one per core); 0 for none."
        ),
    ] = None
    at_once: Annotated[
        int | None,
        worker_option(
            metavar="N",
            min=1,
            help="Of several recordings, so many at once (default: what keeps the workers busy).",
        ),
    ] = None
    listen: Annotated[
        str | None, worker_option(metavar="ENDPOINT", help="Let others' workers join, e.g. tls/0.0.0.0:7447.")
    ] = None
    connect: Annotated[
        str | None, worker_option(metavar="ENDPOINT", help="Join a router where others' workers are.")
    ] = None
    worker_timeout: Annotated[
        float | None,
        worker_option(metavar="SECONDS", help="Stop after so long without any worker (default: wait)."),
    ] = None
    out: Annotated[Path, output_option(metavar="DIR", help="New folder for the results.")]
    resume: Annotated[
        bool, output_option("--resume", help="Go on with the run in --out, if there is one.")
    ] = False
    pictures: Annotated[
        bool,
        output_option(
            "--pictures/--no-pictures", help="Draw pictures at the end; gepf pictures draws them later."
        ),
    ] = True
    results: Annotated[
        str | None, output_option("--publish", metavar="KEY", help="Publish results on this key meanwhile.")
    ] = None
    results_json: Annotated[
        bool, output_option("--publish-json", help="Publish them as JSON, not as MessagePack.")
    ] = False
    quiet: Quiet = False
    as_json: Annotated[
        bool, output_option("--json", help="Print the summary at the end, one JSON object.")
    ] = False


@dataclass(frozen=True, slots=True)
class PublishOptions:
    """All options of `gepf publish` but those of security."""

    sequence: Recording
    key: Annotated[str, typer.Option(metavar="KEY", help="Where, e.g. camera/depth.")]
    rate: Annotated[
        float | None,
        typer.Option(metavar="FPS", help="Frames per second (default: the sequence's own)."),
    ] = None
    frames: Frames = None
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Let trackers connect, e.g. tcp/127.0.0.1:7448.")
    ] = None
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Connect to a tracker's --listen, or a router.")
    ] = None


@dataclass(frozen=True, slots=True)
class PicturesOptions:
    """All options of `gepf pictures`."""

    run: Run
    sequence: Moved = None
    color: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw over these colour frames (default: as tracked).")
    ] = None


@dataclass(frozen=True, slots=True)
class SynthOptions:
    """All options of `gepf synth`."""

    scene: Annotated[str, typer.Argument(metavar="SCENE", help="arm, turn, person, or roam with --model.")]
    out: Annotated[Path, typer.Option(metavar="SEQ", help="New folder for the sequence.")]
    frames: Annotated[int | None, typer.Option(metavar="N", help="Only the first N frames.")] = None
    noise_depth: Annotated[
        float | None, typer.Option(metavar="M", help="Standard deviation along depth (default: none).")
    ] = None
    noise_lateral: Annotated[float | None, typer.Option(metavar="M", help="And across it.")] = None
    kinect: Annotated[bool, typer.Option("--kinect", help="Noise, steps and gaps as a Kinect has them.")] = (
        False
    )
    model: Annotated[
        str | None, typer.Option(metavar="human|FILE.urdf", help="Body that roams: all its joints move.")
    ] = None
    seed: Annotated[int, typer.Option(help="Of the noise, and of who moves how.")] = 0


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """All options of `gepf view`."""

    run: Run
    sequence: Moved = None
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a .rrd file for the rerun viewer instead.")
    ] = None
    port: Annotated[
        int, typer.Option(min=1, max=65534, help="Of the viewer's page; the next one is used, too.")
    ] = 9090
    browser: Annotated[bool, typer.Option(help="Open a browser here.")] = True


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer with the fields of the dataclasses that `command` takes in place of these.

    Names of fields must differ within a command. Their types say with `Annotated` what typer is to know.
    """
    kinds = get_type_hints(command, include_extras=True)
    flat, groups = list[inspect.Parameter](), dict[str, Any]()
    for name, parameter in inspect.signature(command).parameters.items():
        kind = kinds[name]
        if not is_dataclass(kind):
            flat.append(parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=kind))
            continue
        groups[name] = kind
        inner = get_type_hints(kind, include_extras=True)
        for field in fields(kind):
            default = parameter.empty if field.default is MISSING else field.default
            flat.append(
                inspect.Parameter(
                    field.name, parameter.KEYWORD_ONLY, default=default, annotation=inner[field.name]
                )
            )

    def run(**values: Any) -> None:
        for name, value in values.items():
            if isinstance(value, float) and not 0.0 < value < math.inf:
                raise InputError(f"--{name.replace('_', '-')} {value:g} is no number above 0; give another")
        built = {
            name: make(**{field.name: values.pop(field.name) for field in fields(make)})
            for name, make in groups.items()
        }
        command(**built, **values)

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run
