"""The arguments and options of the commands, each a field of a dataclass.

`grouped` converts these fields to parameters of typer. Every option that is a quantity must be above zero.
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
    """The seeds A to B - 1 of `A:B`."""
    first, colon, end = text.partition(":")
    if not colon or not first.isdecimal() or not end.isdecimal() or int(first) >= int(end):
        raise typer.BadParameter(f"'{text}' is not of the form A:B; 0:5 stands for 0, 1, 2, 3 and 4")
    return range(int(first), int(end))


Model = Annotated[str, typer.Argument(metavar="human|FILE", help="Template, URDF, or a person's measures.")]
Recording = Annotated[Path, typer.Argument(metavar="SEQ", help="Recorded depth (docs/formats.md).")]
Run = Annotated[Path, typer.Argument(metavar="DIR", help="Results of gepf track.")]
Force = Annotated[bool, typer.Option("--force", help="Replace FILE if it exists.")]
Quiet = Annotated[bool, output_option("--quiet", "-q", help="Show only errors.")]
Frames = Annotated[str | None, input_option(metavar="A:B", help="Frames A to B - 1.")]
Moved = Annotated[
    Path | None, typer.Option("--sequence", metavar="SEQ", help="The sequence, if it was moved.")
]
Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="SEQ...",
        help="Recorded depth (docs/formats.md), or zenoh:KEY, ros2:/TOPIC, realsense:[SERIAL], orbbec: or "
        "azure-kinect: for live input. "
        "Several recordings, or a .txt file with one per line, share the workers.",
    ),
]


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """Camera parameters that replace those of a recording."""

    intrinsics: Annotated[
        str | None,
        typer.Option(metavar="fx,fy,cx,cy", help="Camera parameters in pixels (default: as recorded)."),
    ] = None
    depth_scale: Annotated[
        float | None,
        typer.Option(metavar="N", help="Units of depth per metre (default: as recorded)."),
    ] = None


@dataclass(frozen=True, slots=True)
class SecurityOptions:
    """Options for the encryption of connections."""

    tls_ca: Annotated[
        Path | None,
        security_option(metavar="FILE", help="Certificate of the authority that signs all certificates."),
    ] = None
    tls_cert: Annotated[Path | None, security_option(metavar="FILE", help="Certificate of this program.")] = (
        None
    )
    tls_key: Annotated[Path | None, security_option(metavar="FILE", help="Key of this certificate.")] = None
    insecure: Annotated[
        bool,
        security_option("--insecure", help="Listen without encryption: anyone on the network can connect."),
    ] = False

    def choose(self, listen: str | None, connect: str | None, **holder: str) -> Security | None:
        """Certificates and access rules for these endpoints; InputError if they do not fit together."""
        from coordinator.security.access import TlsFiles, choose_security

        files = TlsFiles(self.tls_ca, self.tls_cert, self.tls_key)
        return choose_security(listen, connect, files, insecure=self.insecure, **holder)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOptions:
    """Options of `gepf track` without camera and security: input, scene, method, workers, output."""

    sequences: Recordings
    dof: Annotated[
        str | None,
        input_option(metavar="NAME,...", help="Track only these, hold the rest; joints: all but the root."),
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
            metavar="FILE|ros2:/TOPIC",
            help="Joint values by encoders, a CSV with time_s or a ROS bag; they predict the motion.",
        ),
    ] = None
    domain: Annotated[
        int, input_option(metavar="N", min=0, envvar="ROS_DOMAIN_ID", help="Domain of ros2:/TOPIC.")
    ] = 0
    frames: Frames = None
    idle_timeout: Annotated[
        float | None,
        input_option(
            metavar="SECONDS", help="End live input after this time without a frame (default: wait)."
        ),
    ] = None
    record: Annotated[
        Path | None,
        output_option(metavar="DIR", help="Keep the tracked frames of live input in a new folder."),
    ] = None
    rotate: Annotated[
        str,
        input_option(
            metavar="0|90|180|270|auto",
            help="Clockwise rotation in degrees that makes the image upright (default: found).",
        ),
    ] = "auto"
    color: Annotated[
        Path | None, input_option(metavar="DIR", help="Draw results over these colour frames.")
    ] = None
    person: Annotated[
        str,
        scene_option(
            metavar="X,Y|nearest|largest|moving",
            help="The person to track; X,Y is a pixel of the first frame (default: the most likely).",
        ),
    ] = "best"
    people: Annotated[
        int,
        scene_option(
            metavar="N",
            min=1,
            help="Track up to N people at once, each into its own folder in --out: person1, ...",
        ),
    ] = 1
    background: Annotated[
        str | None,
        scene_option(
            metavar="FRAME|SEQ",
            help="The room without people: the number of a frame, a depth PNG, or a sequence.",
        ),
    ] = None
    near: Annotated[float | None, scene_option(metavar="M", help="Ignore everything nearer, metres.")] = None
    far: Annotated[float | None, scene_option(metavar="M", help="Ignore everything farther, metres.")] = None
    roi: Annotated[
        str | None,
        scene_option(metavar="LEFT,TOP,RIGHT,BOTTOM", help="Use only this part of the image, pixels."),
    ] = None
    method: Annotated[
        str, method_option(help="gepf (many hypotheses), gradient (one), condensation or annealed.")
    ] = "gepf"
    preset: Annotated[str, method_option(help="default, or paper (its constants).")] = "default"
    particles: Annotated[
        int | None,
        method_option(metavar="N", min=1, help="Particles per frame; for annealed in each of its 10 layers."),
    ] = None
    points: Annotated[
        int | None, method_option(metavar="N", min=1, help="Largest number of observed points.")
    ] = None
    noise_depth: Annotated[
        float | None,
        method_option(
            metavar="M", help="Noise of the camera in depth (default: measured in the first frame)."
        ),
    ] = None
    noise_lateral: Annotated[
        float | None, method_option(metavar="M", help="Lateral noise of the camera.")
    ] = None
    seed: Annotated[
        int,
        method_option(
            min=0, max=2**32 - 1, help="Seed of all random numbers: the same seed gives the same bytes."
        ),
    ] = 0
    seeds: Annotated[
        range | None,
        method_option(
            metavar="A:B",
            parser=seed_range,
            help="Track with each of the seeds A to B - 1, in folders within --out.",
        ),
    ] = None
    deadline: Annotated[
        float | None,
        method_option(
            metavar="MS", help="Finish a frame with the particles that are refined within this time."
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
            help="Number of recordings tracked at once (default: as many as keep the workers busy).",
        ),
    ] = None
    listen: Annotated[
        str | None,
        worker_option(metavar="ENDPOINT", help="Let other workers join, e.g. at tls/0.0.0.0:7447."),
    ] = None
    connect: Annotated[str | None, worker_option(metavar="ENDPOINT", help="Use the workers at a router.")] = (
        None
    )
    worker_timeout: Annotated[
        float | None,
        worker_option(metavar="SECONDS", help="Stop after this time without any worker (default: wait)."),
    ] = None
    out: Annotated[Path, output_option(metavar="DIR", help="New folder for the results.")]
    resume: Annotated[bool, output_option("--resume", help="Continue the run in --out, if there is one.")] = (
        False
    )
    pictures: Annotated[
        bool,
        output_option(
            "--pictures/--no-pictures", help="Draw pictures at the end; gepf pictures draws them later."
        ),
    ] = True
    results: Annotated[
        str | None,
        output_option(
            "--publish",
            metavar="KEY|ros2:/TOPIC",
            help="Publish results there during the run (default for zenoh:KEY: KEY/results).",
        ),
    ] = None
    results_json: Annotated[
        bool, output_option("--publish-json", help="Publish results as JSON instead of MessagePack.")
    ] = False
    quiet: Quiet = False
    as_json: Annotated[
        bool, output_option("--json", help="Print the summary as a JSON object at the end.")
    ] = False


@dataclass(frozen=True, slots=True)
class PublishOptions:
    """Options of `gepf publish` without security."""

    sequence: Annotated[
        Path,
        typer.Argument(
            metavar="SEQ|CAMERA", help="Recorded depth, or realsense:[SERIAL|FILE], orbbec: or azure-kinect:."
        ),
    ]
    key: Annotated[str, typer.Option(metavar="KEY", help="Key to publish on, e.g. camera/depth.")]
    rate: Annotated[
        float | None,
        typer.Option(metavar="FPS", help="Frames per second (default: as recorded)."),
    ] = None
    frames: Frames = None
    color: Annotated[
        bool,
        typer.Option("--color", help="Publish a camera's colour images, registered to depth, on KEY/color."),
    ] = False
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

    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="arm, turn, person, two, or roam with --model.")
    ]
    out: Annotated[Path, typer.Option(metavar="SEQ", help="New folder for the sequence.")]
    frames: Annotated[int | None, typer.Option(metavar="N", help="Only the first N frames.")] = None
    noise_depth: Annotated[
        float | None,
        typer.Option(metavar="M", help="Standard deviation of the noise in depth (default: none)."),
    ] = None
    noise_lateral: Annotated[float | None, typer.Option(metavar="M", help="Lateral noise.")] = None
    kinect: Annotated[bool, typer.Option("--kinect", help="Noise, quantisation and gaps of a Kinect.")] = (
        False
    )
    model: Annotated[
        str | None,
        typer.Option(metavar="human|FILE.urdf", help="Body of the scene roam, in which all joints move."),
    ] = None
    seed: Annotated[int, typer.Option(help="Seed of noise and motion.")] = 0
    cameras: Annotated[
        int, typer.Option(metavar="N", help="Cameras around the person; several make a rig.")
    ] = 1
    apart: Annotated[float, typer.Option(metavar="DEG", help="Degrees from camera to camera.")] = 90.0
    late: Annotated[float | None, typer.Option(metavar="MS", help="Each camera is so much later.")] = None
    room: Annotated[bool, typer.Option("--room", help="Add floor, ceiling and walls.")] = False


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Options of `gepf view` without security."""

    run: Annotated[
        Path, typer.Argument(metavar="DIR|zenoh:KEY", help="Results of gepf track, or a key with live input.")
    ]
    sequence: Moved = None
    results: Annotated[
        str | None,
        typer.Option(metavar="KEY", help="Key of live results, as in --publish (default: KEY/results)."),
    ] = None
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Let trackers and publishers connect.")
    ] = None
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Connect to a tracker's --listen, or a router.")
    ] = None
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a .rrd file for the rerun viewer instead.")
    ] = None
    port: Annotated[
        int, typer.Option(min=1, max=65534, help="Port of the viewer; the next port is used, too.")
    ] = 9090
    browser: Annotated[bool, typer.Option(help="Open a browser on this host.")] = True


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer, with the fields of the dataclasses that are the parameters of `command`.

    Names of fields must differ within a command. `Annotated` in their types holds the options for typer.
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
                raise InputError(f"--{name.replace('_', '-')} {value:g} is not above 0; give another number")
        built = {
            name: make(**{field.name: values.pop(field.name) for field in fields(make)})
            for name, make in groups.items()
        }
        command(**built, **values)

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run
