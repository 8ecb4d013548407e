"""The arguments and options of all commands but `gepf track`, and those that commands share.

Each option is described once, as a field of a dataclass; `grouped` makes parameters of typer of them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

FORMATS = (
    "Folder of PNG, TUM folder, PLY or PCD clouds, Azure Kinect .mkv, ROS or RealSense bag, "
    "numpy .npz or .npy, UTD-MHAD .mat"
)

security_option = partial(typer.Option, rich_help_panel="Security")
output_option = partial(typer.Option, rich_help_panel="Output")

Model = Annotated[str, typer.Argument(metavar="human|FILE", help="Template, URDF, or a person's measures.")]
Recording = Annotated[Path, typer.Argument(metavar="SEQ", help=f"{FORMATS}.")]
Run = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results of gepf track.")]
Force = Annotated[bool, typer.Option("--force", help="Replace FILE if it is there.")]
Quiet = Annotated[bool, output_option("--quiet", "-q", help="Show no progress; errors stay.")]


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """What a recording does not say of its camera, or says wrongly."""

    intrinsics: Annotated[
        str | None, typer.Option(metavar="fx,fy,cx,cy", help="The camera, pixels (default: as recorded).")
    ] = None
    depth_scale: Annotated[
        float | None, typer.Option(metavar="N", help="Units of depth per metre (default: as recorded).")
    ] = None


RECORDED_CAMERA = CameraOptions()


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


@dataclass(frozen=True, slots=True)
class PublishOptions:
    """All options of `gepf publish` but those of security."""

    sequence: Recording
    key: Annotated[str, typer.Option(metavar="KEY", help="Where, e.g. camera/depth.")]
    rate: Annotated[
        float | None, typer.Option(metavar="FPS", help="Frames per second (default: the sequence's own).")
    ] = None
    frames: Annotated[str | None, typer.Option(metavar="A:B", help="From frame A to before frame B.")] = None
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Let trackers connect, e.g. tcp/127.0.0.1:7448.")
    ] = None
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Connect to a tracker's --listen, or a router.")
    ] = None
    camera: CameraOptions = RECORDED_CAMERA


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """All options of `gepf export`."""

    run: Run
    form: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="csv, mot, c3d, trc, bvh, glb, gltf or json.")
    ]
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")]
    smooth: Annotated[
        float | None, typer.Option(metavar="HZ", help="Low pass without delay, e.g. 6 (default: as tracked).")
    ] = None
    force: Force = False


@dataclass(frozen=True, slots=True)
class PicturesOptions:
    """All options of `gepf pictures`."""

    run: Run
    sequence: Annotated[
        Path | None, typer.Option(metavar="SEQ", help="Where the sequence is now, if it was moved.")
    ] = None
    color: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw over these colour frames (default: as tracked).")
    ] = None


@dataclass(frozen=True, slots=True)
class RouterOptions:
    """Where a router is reached."""

    listen: Annotated[str, typer.Option(metavar="ENDPOINT", help="Where to listen, e.g. tls/0.0.0.0:7447.")]
    connect: Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Another router to connect to.")] = (
        None
    )


@dataclass(frozen=True, slots=True)
class SynthOptions:
    """All options of `gepf synth`."""

    scene: Annotated[str, typer.Argument(metavar="SCENE", help="arm, turn, person, or roam with --model.")]
    out: Annotated[Path, typer.Option(metavar="SEQ", help="New folder for the sequence.")]
    frames: Annotated[int | None, typer.Option(metavar="N", help="Only the first N frames.")] = None
    noise_depth: Annotated[float, typer.Option(metavar="M", help="Standard deviation along depth.")] = 0.0
    noise_lateral: Annotated[float, typer.Option(metavar="M", help="Standard deviation across.")] = 0.0
    kinect: Annotated[bool, typer.Option("--kinect", help="Noise, steps and gaps as a Kinect has them.")] = (
        False
    )
    room: Annotated[bool, typer.Option("--room", help="In a furnished room (person).")] = False
    model: Annotated[
        str | None, typer.Option(metavar="human|FILE.urdf", help="Body that roams: all its joints move.")
    ] = None
    seed: Annotated[int, typer.Option(help="Of the noise, and of who moves how.")] = 0


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """All options of `gepf view`."""

    run: Run
    sequence: Annotated[
        Path | None, typer.Option(metavar="SEQ", help="Where the sequence is now, if it was moved.")
    ] = None
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a .rrd file for the rerun viewer instead.")
    ] = None
    port: Annotated[
        int, typer.Option(min=1, max=65534, help="Of the viewer's page; the next one is used, too.")
    ] = 9090
    browser: Annotated[bool, typer.Option(help="Open a browser here.")] = True


@dataclass(frozen=True, slots=True)
class CertificateOptions:
    """All options of `gepf certificates`."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder; what is good in it stays.")]
    workers: Annotated[
        str, typer.Option(metavar="N|NAME,...", help="How many (worker-0 and so on), or their names.")
    ] = "1"
    hosts: Annotated[
        str, typer.Option(metavar="HOST,...", help="Where coordinator or router listen; this host is.")
    ] = ""
    days: Annotated[int, typer.Option(help="How long they last.")] = 30
    mount: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where a router in a container sees the folder.")
    ] = None


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer with the fields of the dataclasses that `command` takes, however deep they stand.

    Names of fields must differ within a command. Their types say with `Annotated` what typer is to know.
    """
    kinds = get_type_hints(command, include_extras=True)
    kinds.pop("return", None)
    defaults = {name: parameter.default for name, parameter in inspect.signature(command).parameters.items()}
    flat = [p for name, kind in kinds.items() for p in expand(name, kind, defaults[name])]

    def run(**values: Any) -> None:
        command(**{name: build(name, kind, values) for name, kind in kinds.items()})

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run


def expand(name: str, kind: Any, default: Any = inspect.Parameter.empty) -> Iterator[inspect.Parameter]:
    """The parameters that one parameter stands for: itself, or those of its fields."""
    if not is_dataclass(kind):
        yield inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        return
    kinds = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        yield from expand(field.name, kinds[field.name], default)


def build(name: str, kind: Any, values: dict[str, Any]) -> Any:
    """The value of one parameter from the values of all flat ones."""
    make: Callable[..., Any] = kind
    if not is_dataclass(kind):
        return values[name]
    kinds = get_type_hints(kind, include_extras=True)
    return make(**{field.name: build(field.name, kinds[field.name], values) for field in fields(kind)})
