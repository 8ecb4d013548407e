"""The arguments and options of `gepf track`, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from coordinator.commands.options.arguments import (
    FORMATS,
    OUTPUT,
    RECORDED_CAMERA,
    CameraOptions,
    Quiet,
    SecurityOptions,
)

INPUT, SCENE, METHOD, WORKERS = "Input", "Scene", "Method", "Workers"

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
        typer.Option(
            metavar="NAME,...",
            help="Move only these, hold the rest; joints: all but the root.",
            rich_help_panel=INPUT,
        ),
    ] = None
    model: Annotated[
        str,
        typer.Option(
            metavar="human|FILE",
            help="Body to track: a URDF file, or one of gepf fit.",
            rich_help_panel=INPUT,
        ),
    ] = "human"
    init: Annotated[
        str | None,
        typer.Option(
            metavar="auto|FILE",
            help="Pose to start from (default: SEQ/init.json, else auto).",
            rich_help_panel=INPUT,
        ),
    ] = None
    joint_states: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What encoders say of the joints, a CSV with time_s or a ROS bag: where particles go.",
            rich_help_panel=INPUT,
        ),
    ] = None
    frames: Annotated[
        str | None, typer.Option(metavar="A:B", help="From frame A to before frame B.", rich_help_panel=INPUT)
    ] = None
    idle_timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Live input is over after so long without a frame (default: wait).",
            rich_help_panel=INPUT,
        ),
    ] = None
    rotate: Annotated[
        str,
        typer.Option(
            metavar="0|90|180|270|auto",
            help="Degrees clockwise that turn the picture upright (default: found).",
            rich_help_panel=INPUT,
        ),
    ] = "auto"
    color: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Draw results over these colour frames.", rich_help_panel=INPUT),
    ] = None
    camera: CameraOptions = RECORDED_CAMERA


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What of the scene counts, and who in it is tracked."""

    person: Annotated[
        str,
        typer.Option(
            metavar="X,Y|nearest|largest|moving",
            help="Who is tracked, of several: at a pixel of the first frame, or so (default: the likeliest).",
            rich_help_panel=SCENE,
        ),
    ] = "best"
    people: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Track up to so many people at once, each into a folder of its own in --out: person1, ...",
            rich_help_panel=SCENE,
        ),
    ] = 1
    background: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME|SEQ",
            help="The room without anybody: a frame's number, a depth PNG, or a sequence.",
            rich_help_panel=SCENE,
        ),
    ] = None
    near: Annotated[
        float | None,
        typer.Option(metavar="M", help="Nothing nearer counts, metres.", rich_help_panel=SCENE),
    ] = None
    far: Annotated[
        float | None,
        typer.Option(metavar="M", help="Nothing farther counts, metres.", rich_help_panel=SCENE),
    ] = None
    roi: Annotated[
        str | None,
        typer.Option(
            metavar="LEFT,TOP,RIGHT,BOTTOM",
            help="Only this part of the picture counts, pixels.",
            rich_help_panel=SCENE,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """How it is tracked."""

    method: Annotated[
        str,
        typer.Option(
            help="gepf (many hypotheses), gradient (one), condensation or annealed.", rich_help_panel=METHOD
        ),
    ] = "gepf"
    preset: Annotated[
        str, typer.Option(help="default, or paper (its constants).", rich_help_panel=METHOD)
    ] = "default"
    particles: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Particles a frame; of annealed in each of its 10 layers.",
            rich_help_panel=METHOD,
        ),
    ] = None
    points: Annotated[
        int | None,
        typer.Option(metavar="N", help="Observed points a frame, at most.", rich_help_panel=METHOD),
    ] = None
    noise_depth: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="The camera's noise along depth (default: measured in the first frame).",
            rich_help_panel=METHOD,
        ),
    ] = None
    noise_lateral: Annotated[
        float | None, typer.Option(metavar="M", help="And across it.", rich_help_panel=METHOD)
    ] = None
    seed: Annotated[
        int,
        typer.Option(
            help="Of all random numbers: the same seed gives the same bytes.", rich_help_panel=METHOD
        ),
    ] = 0
    seeds: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Track with each of the seeds A to before B, in folders within --out.",
            rich_help_panel=METHOD,
        ),
    ] = None
    deadline: Annotated[
        float | None,
        typer.Option(
            metavar="MS",
            help="Finish a frame with the particles that are refined this long after it came.",
            rich_help_panel=METHOD,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """Who refines the particles."""

    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Lanes of the local worker (default: one per core); 0 for none.",
            rich_help_panel=WORKERS,
        ),
    ] = None
    at_once: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Of several recordings, so many at once (default: what keeps the workers busy).",
            rich_help_panel=WORKERS,
        ),
    ] = None
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Let others' workers join, e.g. tls/0.0.0.0:7447.",
            rich_help_panel=WORKERS,
        ),
    ] = None
    connect: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT", help="Join a router where others' workers are.", rich_help_panel=WORKERS
        ),
    ] = None
    worker_timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Stop after so long without any worker (default: wait).",
            rich_help_panel=WORKERS,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class OutputOptions:
    """Where results go."""

    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="New folder for the results.", rich_help_panel=OUTPUT),
    ]
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with the run in --out, if there is one.", rich_help_panel=OUTPUT
        ),
    ] = False
    pictures: Annotated[
        bool,
        typer.Option(
            "--pictures/--no-pictures",
            help="Draw pictures at the end; gepf pictures draws them later.",
            rich_help_panel=OUTPUT,
        ),
    ] = True
    results: Annotated[
        str | None,
        typer.Option(
            "--publish", metavar="KEY", help="Publish results on this key meanwhile.", rich_help_panel=OUTPUT
        ),
    ] = None
    results_json: Annotated[
        bool,
        typer.Option(
            "--publish-json", help="Publish them as JSON, not as MessagePack.", rich_help_panel=OUTPUT
        ),
    ] = False
    quiet: Quiet = False
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the summary at the end, one JSON object.", rich_help_panel=OUTPUT),
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
