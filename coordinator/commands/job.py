"""The options of one `gepf track`, checked before anything is read or written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from gepf.common.errors import InputError
from gepf.common.protocol.keys import check_name, check_stream
from gepf.common.transport.session import holder_name
from gepf.coordinator.bodies.choice import choose_model
from gepf.coordinator.bodies.human.dofs import HUMAN
from gepf.coordinator.commands.options import CameraOptions, SecurityOptions, TrackOptions
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.configuration import AUTOMATIC
from gepf.coordinator.scene.scope import PERSON_CRITERIA, Scope
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from gepf.coordinator.sources.joint_states import JointStates, read_joint_states
from gepf.coordinator.sources.live_stream import is_topic, live_key
from gepf.coordinator.sources.rig import live_cameras
from gepf.coordinator.sources.ros2_input import JointTopic

T = TypeVar("T")

ROTATIONS = ("auto", "0", "90", "180", "270")


@dataclass(frozen=True, slots=True)
class Job:
    """One run of `gepf track`. A field with the name of an option has its value, checked or interpreted."""

    sequence: Path
    out: Path | None  # None: results of live input are not stored
    settings: Settings
    pool: Pool
    model: str = HUMAN  # or a file
    active: tuple[str, ...] | None = None  # None for the default of the model
    init: str | None = None  # a file, AUTOMATIC, or None for the sequence's own file, if there is one
    frames: str | None = None
    resume: bool = False
    color: Path | None = None  # colour frames, also for pictures; None: those beside depth, if there are any
    no_color: bool = False  # depth alone
    given: GivenCamera = AS_RECORDED
    results: str | None = None  # key or topic on which they are published
    results_json: bool = False
    scope: Scope = field(default_factory=Scope)  # without the background
    background: str | None = None  # a frame's number, a picture or a recording of the empty room
    people: int = 1  # largest number
    pictures: bool = True
    joint_states: JointStates | JointTopic | None = None  # by encoders
    idle_timeout: float | None = None  # seconds without a frame until live input is over
    record: Path | None = None  # new folder for the tracked frames of live input
    domain: int = 0  # of ROS 2

    @property
    def folder(self) -> Path:
        """The folder of the results; only for a run that stores them."""
        assert self.out is not None
        return self.out

    @property
    def uses_ros(self) -> bool:
        """Whether frames come from ROS 2, or results go there."""
        return is_topic(live_key(self.sequence)) or is_topic(self.results)


def choose_job(options: TrackOptions, camera: CameraOptions, security: SecurityOptions) -> Job:
    """The job that the options describe; InputError for options that exclude each other."""
    if options.workers == 0 and options.listen is None and options.connect is None:
        raise InputError("--workers 0 needs other workers; add --listen ENDPOINT or --connect ENDPOINT")
    pool = Pool(
        options.workers,
        options.listen,
        options.connect,
        security.choose(options.listen, options.connect),
        options.worker_timeout,
        check_name("--kind", options.kind),
    )
    as_given = {name: value for name, value in asdict(options).items() if name in Job.__dataclass_fields__}
    interpreted: dict[str, Any] = {
        "sequence": recordings_of(options)[0],
        "settings": choose_settings(options),
        "pool": pool,
        "model": choose_model(options.model),
        "active": split(options.dof, "--dof", str) if options.dof is not None else None,
        "given": camera.choose(),
        "results": live_key(options.results or "") or options.results,
        "scope": choose_scope(options),
        "joint_states": None,
    }
    job = Job(**as_given | interpreted)
    if options.joint_states is not None:
        if is_several(options) or job.people > 1:
            raise InputError("--joint-states is for one body in one recording; track that recording alone")
        topic = live_key(options.joint_states)
        keys = [each.key for each in live_cameras(job.sequence)]
        if (topic or keys) and not (keys and all(map(is_topic, [topic, *keys]))):
            raise InputError("give --joint-states FILE for a recording, or ros2:/TOPIC for depth from ROS 2")
        states = read_joint_states(options.joint_states) if topic is None else JointTopic(topic)
        job = replace(job, joint_states=states)
    if job.people > 1 and job.model != HUMAN:
        raise InputError("--people estimates the size of each person; leave --model out")
    if job.people > 1 and job.init not in (None, AUTOMATIC):
        raise InputError("--init is the pose of one person; with --people all are detected, so leave it out")
    if job.color is not None and job.no_color:
        raise InputError("--color and --no-color exclude each other; leave one of them out")
    check_outputs(job, several=is_several(options))
    check_folder(job, several=is_several(options), as_json=options.as_json)
    return job


def check_outputs(job: Job, *, several: bool) -> None:
    """InputError for outputs that the input does not have, or that nobody could receive."""
    if job.results_json and (job.results is None or is_topic(job.results)):
        raise InputError("--publish-json needs a key of Zenoh for the results; add --publish KEY")
    if job.uses_ros and (job.pool.connect is None or job.pool.security is not None):
        raise InputError(
            "ROS 2 topics are reached at their Zenoh router, unencrypted; leave --tls-* out, and add "
            "--connect tcp/HOST:7447 (for another host, also --insecure)"
        )
    if job.results is not None and not is_topic(job.results):
        if job.pool.listen is None and job.pool.connect is None:
            raise InputError("a subscriber needs an endpoint; add --listen ENDPOINT or --connect ENDPOINT")
        check_stream(job.results, holder_name(job.pool.security))
    if job.record is not None and (several or not live_cameras(job.sequence)):
        raise InputError("--record is for live input (zenoh:KEY); leave it out")


def check_folder(job: Job, *, several: bool, as_json: bool) -> None:
    """InputError if there is no folder for the results and they need one; only live input does not."""
    if job.out is not None:
        return
    if several or not live_cameras(job.sequence):
        raise InputError("the results of a recording need a folder; add --out DIR with a new folder")
    if as_json:
        raise InputError("--json prints the summary of stored results; add --out DIR, or leave --json out")


def choose_settings(options: TrackOptions) -> Settings:
    """The settings of a preset with the user's values. If the noise is given, it is not measured."""
    if options.rotate not in ROTATIONS:
        raise InputError(f"--rotate {options.rotate} is not valid; give one of {', '.join(ROTATIONS)}")
    turn = None if options.rotate == "auto" else int(options.rotate)
    settings = settings_for(options.method, options.preset, options.particles, options.points, options.seed)
    given = {"noise_depth": options.noise_depth, "noise_lateral": options.noise_lateral}
    given = {name: value for name, value in given.items() if value is not None}
    refine = msgspec.structs.replace(settings.refine, **given)
    measured = settings.measure_noise and not given
    return msgspec.structs.replace(settings, rotate_deg=turn, refine=refine, measure_noise=measured)


def choose_scope(options: TrackOptions) -> Scope:
    """The scope of tracking, without the background."""
    near, far = options.near, options.far
    if near is not None and far is not None and near >= far:
        raise InputError(f"--near {near:g} is not below --far {far:g}; no pixel would remain")
    region = None
    if options.roi is not None:
        left, top, right, bottom = split(options.roi, "--roi", int, 4)
        region = (left, top, right, bottom)
        if not (left < right and top < bottom):
            raise InputError(f"--roi {options.roi} contains no pixel; give left,top,right,bottom")
    person: str | tuple[int, int] = options.person
    if options.person not in PERSON_CRITERIA:
        if "," not in options.person:
            choices = ", ".join(PERSON_CRITERIA[1:])
            raise InputError(f"--person {options.person} is unknown; give X,Y in pixels or one of {choices}")
        column, row = split(options.person, "--person", int, 2)
        person = (column, row)
    return Scope(near, far, region, person)


def split(text: str, option: str, kind: Callable[[str], T], count: int | None = None) -> tuple[T, ...]:
    """The items of a comma-separated list: exactly `count` of them, or at least one."""
    try:
        found = tuple(kind(part.strip()) for part in text.split(",") if part.strip())
    except ValueError:
        found = ()
    if not found or count not in (None, len(found)):
        what = "names" if count is None else f"{count} whole numbers"
        raise InputError(f"{option} {text} is not understood; give {what} separated by commas")
    return found


def is_several(options: TrackOptions) -> bool:
    """Whether the options describe several runs, each with its own folder in `--out`."""
    return options.listed is not None or len(recordings_of(options)) > 1


def recordings_of(options: TrackOptions) -> Sequence[Path]:
    """What is tracked; InputError if it is missing, given twice, or an unreadable list."""
    given = options.sequences or []
    if options.index is not None and options.listed is None:
        raise InputError("--index selects a recording of a list; add --list FILE")
    if options.listed is None:
        if not given:
            raise InputError("there is nothing to track; give a recording, or --list FILE")
        return given
    if given:
        raise InputError(f"--list and {given[0]} both say what to track; give only one of them")
    return read_list(options.listed)


def read_list(file: Path) -> Sequence[Path]:
    """The recordings of a list: one per line, relative to the folder of the list; # starts a comment."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {file}: {error}; give a text file, one recording per line") from None
    found = [file.parent / text for line in lines if (text := line.split("#", 1)[0].strip())]
    if not found:
        raise InputError(f"{file} is empty; write one recording per line")
    return found
