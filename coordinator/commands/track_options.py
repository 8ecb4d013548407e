"""The arguments and options of `gepf track`, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from coordinator.commands.options import (
    FORMATS,
    RECORDED_CAMERA,
    CameraOptions,
    Quiet,
    SecurityOptions,
    output_option,
)

input_option = partial(typer.Option, rich_help_panel="Input")
scene_option = partial(typer.Option, rich_help_panel="Scene")
method_option = partial(typer.Option, rich_help_panel="Method")
worker_option = partial(typer.Option, rich_help_panel="Workers")

RecordingsOrStream = Annotated[
    list[Path],
    typer.Argument(
        metavar="SEQ...",
        help=f"{FORMATS}; zenoh:KEY for live input; several, or a .txt file with one a line, share a pool.",
    ),
]


@dataclass(frozen=True, slots=True)
class InputOptions:
    """What is tracked."""

    sequences: RecordingsOrStream
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
    frames: Annotated[str | None, input_option(metavar="A:B", help="From frame A to before frame B.")] = None
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
    camera: CameraOptions = RECORDED_CAMERA


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What of the scene counts, and who in it is tracked."""

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


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """How it is tracked."""

    method: Annotated[
        str, method_option(help="gepf (many hypotheses), gradient (one), condensation or annealed.")
    ] = "gepf"
    preset: Annotated[str, method_option(help="default, or paper (its constants).")] = "default"
    particles: Annotated[
        int | None,
        method_option(metavar="N", help="Particles a frame; of annealed in each of its 10 layers."),
    ] = None
    points: Annotated[int | None, method_option(metavar="N", help="Observed points a frame, at most.")] = None
    noise_depth: Annotated[
        float | None,
        method_option(
            metavar="M", help="The camera's noise along depth (default: measured in the first frame)."
        ),
    ] = None
    noise_lateral: Annotated[float | None, method_option(metavar="M", help="And across it.")] = None
    seed: Annotated[int, method_option(help="Of all random numbers: the same seed gives the same bytes.")] = 0
    seeds: Annotated[
        str | None,
        method_option(
            metavar="A:B", help="Track with each of the seeds A to before B, in folders within --out."
        ),
    ] = None
    deadline: Annotated[
        float | None,
        method_option(
            metavar="MS", help="Finish a frame with the particles that are refined this long after it came."
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """Who refines the particles."""

    workers: Annotated[
        int | None,
        worker_option(metavar="N", help="Lanes of the local worker (default: one per core); 0 for none."),
    ] = None
    at_once: Annotated[
        int | None,
        worker_option(
            metavar="N", help="Of several recordings, so many at once (default: what keeps the workers busy)."
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


@dataclass(frozen=True, slots=True)
class OutputOptions:
    """Where results go."""

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
class TrackOptions:
    """All options of `gepf track`."""

    input: InputOptions
    scene: SceneOptions
    output: OutputOptions
    method: MethodOptions
    pool: WorkerOptions
    security: SecurityOptions
