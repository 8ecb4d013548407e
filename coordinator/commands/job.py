"""One `gepf track` as its options ask for it, checked before anything is read or written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from common.errors import InputError
from common.protocol.keys import check_stream
from common.settings import Settings
from common.transport.session import COORDINATOR, Security
from coordinator.bodies.choice import choose_model
from coordinator.bodies.human.dofs import HUMAN
from coordinator.commands.options import SecurityOptions
from coordinator.commands.scope import choose_scope
from coordinator.commands.track_options import TrackOptions
from coordinator.filters.methods import find_method, settings_for
from coordinator.pool.options import Pool
from coordinator.results.configuration import AUTOMATIC
from coordinator.scene.scope import Scope
from coordinator.security.access import TlsFiles, choose_security
from coordinator.sources.camera import AS_RECORDED, CameraOptions, parse_camera_options
from coordinator.sources.joint_states import JointStates, read_joint_states
from coordinator.sources.live import live_key

LARGEST_NOISE_M = 1.0

QUARTERS_DEG = (0, 90, 180, 270)  # that --rotate knows


@dataclass(frozen=True, slots=True)
class Job:
    """One `gepf track`."""

    sequence: Path
    out: Path
    settings: Settings
    pool: Pool
    model: str = HUMAN  # or a file
    active: tuple[str, ...] | None = None  # None for the model's own choice
    init: str | None = None  # a file, AUTOMATIC, or None for the sequence's own file if it has one
    frames: str | None = None
    resume: bool = False
    colour: Path | None = None  # frames to draw results over
    given: CameraOptions = AS_RECORDED  # of the camera
    results: str | None = None  # a key on which they are published meanwhile
    results_json: bool = False
    scope: Scope = field(default_factory=Scope)  # what of the scene is tracked, but for the background
    background: str | None = None  # a frame's number, a picture or a recording of the empty room
    people: int = 1  # at the most, at once
    pictures: bool = True
    joint_states: JointStates | None = None  # what encoders say
    idle_timeout: float | None = None  # seconds without a frame until live input is over


def choose_job(options: TrackOptions) -> Job:
    """What the options ask for; InputError for what makes no sense."""
    source, method, pool, output = options.input, options.method, options.pool, options.output
    settings = choose_settings(method.method, method.preset, method.particles, method.points, method.seed)
    settings = set_noise(settings, method.noise_depth, method.noise_lateral)
    if source.rotate not in ("auto", *map(str, QUARTERS_DEG)):
        choices = ", ".join(map(str, QUARTERS_DEG))
        raise InputError(f"--rotate {source.rotate} makes no sense; give {choices} or auto")
    if source.rotate != "auto":
        settings = msgspec.structs.replace(settings, rotate_deg=int(source.rotate))
    if method.deadline is not None and not find_method(method.method).descends:
        raise InputError(f"method {method.method} needs an answer for every particle; leave --deadline out")
    deadline = above_zero("--deadline", method.deadline, "time for a frame; give milliseconds")
    security = secure(options.security, pool.listen, pool.connect)
    job = Job(
        sequence=source.sequences[0],
        out=output.out,
        settings=settings,
        pool=choose_pool(
            pool.workers,
            pool.listen,
            pool.connect,
            security,
            pool.worker_timeout,
            None if deadline is None else deadline / 1000,
        ),
        model=choose_model(source.model),
        active=choose_dofs(source.dof),
        init=source.init,
        frames=source.frames,
        resume=output.resume,
        colour=source.color,
        results=output.results,
        results_json=output.results_json,
        given=parse_camera_options(source.camera.intrinsics, source.camera.depth_scale),
        scope=choose_scope(options.scene),
        background=options.scene.background,
        people=at_least(1, "--people", options.scene.people),
        joint_states=choose_joint_states(options),
        pictures=output.pictures,
        idle_timeout=above_zero("--idle-timeout", source.idle_timeout, "time to wait; give seconds"),
    )
    refuse_misfits(job)
    return job


def refuse_misfits(job: Job) -> None:
    """InputError for options that do not go together."""
    if job.people > 1 and job.model != HUMAN:
        raise InputError("--people is for people whose measures are found; leave out --model")
    if job.people > 1 and job.init not in (None, AUTOMATIC):
        raise InputError("--init is the pose of one person; with --people all are found, so leave it out")
    if job.results is None:
        if job.results_json:
            raise InputError("--publish-json says how results are published; add --publish KEY")
        return
    if job.pool.listen is None and job.pool.connect is None:
        raise InputError("nobody could hear the results; add --listen or --connect with an endpoint")
    check_stream(job.results, guarded=job.pool.security is not None)


def choose_settings(
    method: str, preset_name: str, particles: int | None, points: int | None, seed: int
) -> Settings:
    """A preset's settings with what the user asked for instead."""
    if not 0 <= seed < 2**63:
        raise InputError(f"--seed {seed} is out of range; give 0 to {2**63 - 1}")
    for option, number in (("--particles", particles), ("--points", points)):
        if number is not None:
            at_least(1, option, number)
    return msgspec.structs.replace(settings_for(method, preset_name, particles, points), seed=seed)


def set_noise(settings: Settings, depth: float | None, lateral: float | None) -> Settings:
    """Settings for a camera's noise that is known, metres; None leaves the preset's, or both are measured."""
    given = {"noise_depth": depth, "noise_lateral": lateral}
    given = {name: value for name, value in given.items() if value is not None}
    for name, value in given.items():
        if value is not None and not 0.0 < value <= LARGEST_NOISE_M:
            option = "--" + name.replace("_", "-")
            raise InputError(f"{option} {value:g} is out of range; give metres, above 0 and up to 1")
    if not given:
        return settings
    refine = msgspec.structs.replace(settings.refine, **given)
    return msgspec.structs.replace(settings, refine=refine, measure_noise=False)


def secure(
    options: SecurityOptions, listen: str | None, connect: str | None, holder: str = COORDINATOR
) -> Security | None:
    """Certificate and access rules for these endpoints; InputError where they do not fit together."""
    files = TlsFiles(options.tls_ca, options.tls_cert, options.tls_key)
    return choose_security(listen, connect, files, holder=holder, insecure=options.insecure)


def choose_pool(
    workers: int | None,
    listen: str | None,
    connect: str | None,
    security: Security | None = None,
    worker_timeout: float | None = None,
    deadline: float | None = None,
) -> Pool:
    """Workers and endpoints; without workers of our own there must be a way for others to join."""
    above_zero("--worker-timeout", worker_timeout, "time to wait; give seconds")
    if workers is not None:
        at_least(0, "--workers", workers)
    if workers == 0 and listen is None and connect is None:
        raise InputError("with --workers 0 nobody could join; add --listen or --connect with an endpoint")
    return Pool(workers, listen, connect, security, worker_timeout, deadline)


def choose_dofs(names: str | None) -> tuple[str, ...] | None:
    """Names of degrees of freedom between commas; None for the model's own choice."""
    if names is None:
        return None
    listed = tuple(name.strip() for name in names.split(",") if name.strip())
    if not listed:
        raise InputError("--dof names nothing; give names between commas, such as r_elbow_flexion")
    return listed


def choose_joint_states(options: TrackOptions) -> JointStates | None:
    """What --joint-states says; InputError where it cannot belong to what is tracked."""
    path, source = options.input.joint_states, options.input
    if path is None:
        return None
    if is_several(source.sequences, None) or live_key(source.sequences[0]) is not None:
        raise InputError("--joint-states belongs to one recording; track it alone")
    if options.scene.people > 1:
        raise InputError("--joint-states belongs to one body; leave --people out")
    return read_joint_states(path)


def above_zero(option: str, value: float | None, needed: str) -> float | None:
    """`value`, if it is missing or above zero; InputError says what is needed."""
    if value is not None and not 0.0 < value < math.inf:
        raise InputError(f"{option} {value:g} is no {needed} above 0")
    return value


def at_least(least: int, option: str, number: int) -> int:
    """`number`, if it is not too small."""
    if number < least:
        raise InputError(f"{option} {number} is too small; give {least} or more")
    return number


def is_several(sequences: Sequence[Path], seeds: str | None) -> bool:
    """Whether more than one run is asked for, each of which gets a folder within `--out`."""
    return len(sequences) > 1 or seeds is not None or is_list(sequences[0])


def is_list(path: Path) -> bool:
    """Whether a path is a file that lists recordings."""
    return path.suffix == ".txt" and not path.is_dir()
