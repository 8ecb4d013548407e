"""The arguments and options of the commands, each a field of a dataclass."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gepf.common.bounds import LARGEST, MAX_PARTICLES, SMALLEST
from gepf.common.offer import CPU

if TYPE_CHECKING:
    from gepf.common.transport.session import Security
    from gepf.coordinator.sources.camera import GivenCamera


def option(metavar: str, text: str, *names: str, default: Any = None, panel: str = "", **limits: Any) -> Any:
    """A field with an option: the name of its value, its help, its names if they differ from the field's."""
    shown = typer.Option(*names, metavar=metavar or None, help=text, rich_help_panel=panel or None, **limits)
    return field(default=default, metadata={"typer": shown})


def argument(metavar: str, text: str, default: Any = MISSING) -> Any:
    """A field with an argument: the name of its value, and its help."""
    return field(default=default, metadata={"typer": typer.Argument(metavar=metavar, help=text)})


security_option = partial(option, panel="Security")
input_option = partial(option, panel="Input")
scene_option = partial(option, panel="Scene")
method_option = partial(option, panel="Method")
worker_option = partial(option, panel="Workers")
output_option = partial(option, panel="Output")

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show only errors.", rich_help_panel="Output")]
Body = Annotated[str, typer.Argument(metavar="human|FILE", help="Body: a URDF file, or a file of measures.")]
RUN = "Results of gepf track."
FORCE = "Replace FILE if it exists."
MOVED = "New path of the sequence, if it was moved."
FRAMES = "Frames A to B - 1."
OTHER_SIDE = "Connect to the --listen endpoint of a tracker, or to a router."


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """Options of `gepf demo`."""

    out: Path | None = option("DIR", "Folder for the demo (default: gepf-demo).")
    scene: str = option("person|arm", "Fast people, or the paper's arm with noise.", default="person")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """Camera parameters that replace those of a recording."""

    intrinsics: str | None = option("fx,fy,cx,cy", "Camera parameters in pixels (default: as recorded).")
    depth_scale: float | None = option("N", "Units of depth per metre (default: as recorded).")
    mirrored: bool | None = option(
        "", "Whether the images were recorded mirrored, to undo it.", "--mirrored/--not-mirrored"
    )

    def choose(self) -> GivenCamera:
        """These parameters; InputError if they are invalid."""
        from gepf.coordinator.sources.camera import parse_camera

        return parse_camera(self.intrinsics, self.depth_scale, self.mirrored)


@dataclass(frozen=True, slots=True, kw_only=True)
class SecurityOptions:
    """Options for the encryption of connections."""

    tls_ca: Path | None = security_option("FILE", "Certificate of the authority that signs all certificates.")
    tls_cert: Path | None = security_option("FILE", "Certificate of this program.")
    tls_key: Path | None = security_option("FILE", "Private key of the certificate in --tls-cert.")
    insecure: bool = security_option(
        "", "Allow unencrypted links to other hosts: anyone can connect or read.", "--insecure", default=False
    )

    def choose(self, listen: str | None, connect: str | None, **holder: str) -> Security | None:
        """Certificates and access rules for these endpoints; InputError if they do not fit together."""
        from gepf.coordinator.security.access import TlsFiles, choose_security

        files = TlsFiles(self.tls_ca, self.tls_cert, self.tls_key)
        return choose_security(listen, connect, files, insecure=self.insecure, **holder)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOptions:
    """Options of `gepf track` without camera and security: input, scene, method, workers, output."""

    sequences: list[Path] | None = argument(
        "[SEQ...]",
        "Recorded depth (docs/formats.md), or live: zenoh:KEY, ros2:/TOPIC, realsense:[SERIAL], orbbec:, "
        "azure-kinect:. Several recordings share the workers.",
        default=None,
    )
    listed: Path | None = input_option("FILE", "File with one recording per line, instead of SEQ.", "--list")
    index: int | None = input_option("N", "Track only recording N of --list, counted from 0.", min=0)
    dof: str | None = input_option("NAME,...", "Degrees of freedom to track; `joints`: all but the root's.")
    model: str = input_option("human|FILE", "Body: a URDF file, or a file of measures.", default="human")
    init: str | None = input_option("auto|FILE", "Pose to start from (default: SEQ/init.json, else auto).")
    joint_states: Path | None = input_option(
        "FILE|ros2:/TOPIC", "Joint values from encoders: a CSV with time_s, or a ROS bag."
    )
    domain: int = input_option("N", "ROS domain of ros2:/TOPIC.", default=0, min=0, envvar="ROS_DOMAIN_ID")
    frames: str | None = input_option("A:B", FRAMES)
    idle_timeout: float | None = input_option("SECONDS", "End live input after this silence (default: none).")
    record: Path | None = output_option("DIR", "Keep the tracked frames of live input in a new folder.")
    rotate: str = input_option(
        "0|90|180|270|auto", "Clockwise degrees that make images upright (default: detected).", default="auto"
    )
    color: Path | None = input_option(
        "DIR", "Colour frames to use and to draw over (default: use SEQ/color)."
    )
    no_color: bool = input_option("", "Use depth alone.", "--no-color", default=False)
    person: str = scene_option(
        "X,Y|nearest|largest|moving", "The person to track; X,Y is a pixel.", default="best"
    )
    people: int = scene_option("N", "Track up to N people, into --out/person1, ...", default=1, min=1)
    background: str | None = scene_option(
        "FRAME|SEQ", "The empty room: a frame's number, a depth PNG, or a sequence."
    )
    near: float | None = scene_option("M", "Ignore what is nearer than M metres.")
    far: float | None = scene_option("M", "Ignore what is farther than M metres.")
    roi: str | None = scene_option("LEFT,TOP,RIGHT,BOTTOM", "Use only this part of the image, pixels.")
    method: str = method_option(
        "NAME", "gepf, gradient (one particle), condensation or annealed.", default="gepf"
    )
    preset: str = method_option("NAME", "default, or paper (as published).", default="default")
    particles: int | None = method_option("N", "Particles per frame; with annealed, per layer.", min=1)
    points: int | None = method_option("N", "Largest number of observed points.", min=1)
    noise_depth: float | None = method_option(
        "M", "Noise in depth (default: measured in the first frame).", min=SMALLEST, max=LARGEST
    )
    noise_lateral: float | None = method_option("M", "Lateral noise.", min=SMALLEST, max=LARGEST)
    seed: int = method_option("N", "The same seed gives the same bytes.", default=0, min=0, max=2**32 - 1)
    workers: int | None = worker_option(
        "N", "Threads of the local worker (default: all cores; 0: none).", min=0, max=MAX_PARTICLES
    )
    kind: str = worker_option("NAME", "Use only workers with this kernel.", default=CPU)
    listen: str | None = worker_option("ENDPOINT", "Let other workers join, e.g. at tls/0.0.0.0:7447.")
    connect: str | None = worker_option("ENDPOINT", "Use the workers at a router.")
    worker_timeout: float | None = worker_option("SECONDS", "Stop if no worker joins (default: wait).")
    out: Path | None = output_option("DIR", "New folder for the results; optional for live input.")
    resume: bool = output_option("", "Continue the run in --out, if there is one.", "--resume", default=False)
    pictures: bool = output_option("", "Draw pictures at the end.", "--pictures/--no-pictures", default=True)
    results: str | None = output_option(
        "KEY|ros2:/TOPIC", "Publish results there (default for zenoh:KEY: KEY/results).", "--publish"
    )
    results_json: bool = output_option("", "Publish results as JSON.", "--publish-json", default=False)
    quiet: Quiet = False
    as_json: bool = output_option("", "Print the summary as JSON.", "--json", default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class InfoOptions:
    """Options of `gepf info` without camera."""

    sequence: Path = argument("SEQ", "Recorded depth or a run's folder.")
    as_json: bool = option("", "Print one JSON object.", "--json", default=False)
    picture: Path | None = option("FILE", "Draw the detected floor, walls and people as PNG.")


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateOptions:
    """Options of `gepf calibrate`."""

    sequences: list[Path] = argument("A B [C ...]", "Simultaneous recordings, one per camera.")
    out: Path = option("FILE.json", "Rig file to write.", default=MISSING)
    given: Path | None = option("FILE|DIR", "Take the poses from Kalibr, ROS or 4 x 4 matrices.", "--from")
    force: bool = option("", FORCE, "--force", default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class SynthOptions:
    """All options of `gepf synth`."""

    scene: str = argument("SCENE", "arm, turn, person, two, or roam with --model.")
    out: Path = option("SEQ", "New folder for the sequence.", default=MISSING)
    frames: int | None = option("N", "Only the first N frames.")
    noise_depth: float | None = option("M", "Standard deviation of the noise in depth (default: none).")
    noise_lateral: float | None = option("M", "Lateral noise.")
    kinect: bool = option("", "Noise, quantisation and gaps of a Kinect.", "--kinect", default=False)
    model: str | None = option("human|FILE.urdf", "Body of the scene roam, in which all joints move.")
    seed: int = option("N", "Seed of noise and motion.", default=0)
    cameras: int = option("N", "Cameras around the person; several make a rig.", default=1)
    apart: float = option("DEG", "Angle between neighbouring cameras.", default=90.0)
    late: float | None = option("MS", "Delay of each camera after the one before it.")
    room: bool = option("", "Add floor, ceiling and walls.", "--room", default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishOptions:
    """Options of `gepf publish` without security."""

    sequence: Path = argument(
        "SEQ|CAMERA", "Recorded depth, or realsense:[SERIAL|FILE], orbbec:, azure-kinect:."
    )
    key: str = option("KEY", "Key to publish on, e.g. camera/depth.", default=MISSING)
    rate: float | None = option("FPS", "Frames per second (default: as recorded).")
    frames: str | None = input_option("A:B", FRAMES)
    color: bool = option("", "Publish a camera's colour images on KEY/color.", "--color", default=False)
    listen: str | None = option("ENDPOINT", "Let trackers connect, e.g. tcp/127.0.0.1:7448.")
    connect: str | None = option("ENDPOINT", OTHER_SIDE)


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificatesOptions:
    """Options of `gepf certificates`."""

    out: Path = option("DIR", "Folder to fill; certificates that need no renewal are kept.", default=MISSING)
    workers: str = option("N|NAME,...", "How many workers (worker-0, ...), or their names.", default="1")
    coordinators: str = option("NAME,...", "Further coordinators, sharing a pool at a router.", default="")
    hosts: str = option("HOST,...", "Other hosts where a coordinator or router listens.", default="")
    days: int = option("N", "Days of validity (the authority has ten years).", default=30, min=1)
    mount: Path | None = option("DIR", "Path of this folder inside a router's container.")


@dataclass(frozen=True, slots=True, kw_only=True)
class RouterOptions:
    """Options of `gepf router` without security."""

    listen: str = option("ENDPOINT", "Where to listen, e.g. tls/0.0.0.0:7447.", default=MISSING)
    connect: str | None = option("ENDPOINT", "Another router to join.")


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateOptions:
    """Options of `gepf evaluate`."""

    runs: list[Path] = argument("DIR...", "Folders with results of gepf track.")
    truth: Path | None = option("FILE", "Ground truth (default: the sequence's own).")
    csv: bool = option("", "Print CSV, one line per run; required for several runs.", "--csv", default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Options of `gepf export`."""

    run: Path = argument("DIR", RUN)
    form: str = option(
        "FORMAT",
        "bvh, c3d, csv, glb, gltf, json, mot or trc; obj, pcd, ply or xyz of one frame.",
        "--to",
        default=MISSING,
    )
    out: Path = option("FILE", "File to write.", default=MISSING)
    frame: int | None = option("N", "The frame for obj, pcd, ply, xyz (default: first tracked).")
    smooth: float | None = option("HZ", "Low-pass filter without delay, e.g. 6 (default: no filter).")
    force: bool = option("", FORCE, "--force", default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class PicturesOptions:
    """Options of `gepf pictures`."""

    run: Path = argument("DIR", RUN)
    sequence: Path | None = option("SEQ", MOVED)
    color: Path | None = option("DIR", "Draw over these colour frames (default: as tracked).")


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """Options of `gepf view` without security."""

    run: Path = argument("DIR|zenoh:KEY", "Results of gepf track, or a key with live input.")
    sequence: Path | None = option("SEQ", MOVED)
    results: str | None = option("KEY", "Key of live results, as in --publish (default: KEY/results).")
    listen: str | None = option("ENDPOINT", "Let trackers and publishers connect.")
    connect: str | None = option("ENDPOINT", OTHER_SIDE)
    save: Path | None = option("FILE", "Write a .rrd file for the rerun viewer instead.")
    port: int = option("N", "Port of the viewer; the next port is used, too.", default=9090, min=1, max=65534)
    browser: bool = option("", "Open a browser on this host.", default=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """Options of `gepf report`."""

    run: Path = argument("DIR", RUN)
    out: Path | None = option("FILE", "Page to write (default: DIR/report.html).")
