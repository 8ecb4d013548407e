"""What `gepf track` tracks: frames that were recorded, or that are published meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from pathlib import Path

from common.errors import InputError
from common.frame import DepthFrame
from common.protocol.keys import check_stream
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.dofs import HUMAN_DOFS
from coordinator.commands.job import Job
from coordinator.commands.progress import Show, counted
from coordinator.commands.scope import complete_scope
from coordinator.commands.workers import Workers
from coordinator.filters.methods import keep_up
from coordinator.results.configuration import AUTOMATIC, Asked, live_run_configuration, run_configuration
from coordinator.results.evaluation import read_truth
from coordinator.sources import Source, open_source
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.live import LiveFrames, from_first_seen
from coordinator.sources.source import select_frames
from coordinator.tracking.known_motion import KnownMotion
from coordinator.tracking.state import read_start

MEND_STREAM = "is its publisher running, with this key and endpoint, and is its depth above 0?"


class Input:
    """What a run works with besides its frames: the job, bodies, where to start, what of the scene counts."""

    def __init__(self, job: Job, source: Source | None) -> None:
        self.job = job
        self.bodies = choose_bodies(job.active, job.settings.preset, job.model)
        self.start = choose_start(job.init, source, self.bodies.dof_names) if job.people == 1 else None
        self.scope = complete_scope(job.scope, job.background, source, job.settings.rotate_deg)
        self.motion = None if job.joint_states is None else KnownMotion(job.joint_states)

    def asked(self) -> Asked:
        """What decides the results besides the frames."""
        job, states = self.job, None if self.job.joint_states is None else self.job.joint_states.hash
        deadline = job.pool.deadline
        return Asked(
            job.settings,
            self.bodies,
            job.model,
            job.active,
            self.start,
            deadline,
            self.scope,
            states,
            job.people,
        )


class RecordedInput(Input):
    """A recording: every frame is tracked, and read when it is its turn. InputError where it does not fit."""

    def __init__(self, job: Job) -> None:
        self.source = source = open_source(job.sequence, job.given)
        self.numbers = numbers = select_frames(source.numbers, job.frames)
        self.total = len(numbers)
        super().__init__(job, source)
        if job.joint_states is not None:
            job.joint_states.check_names(self.bodies.dof_names)
        # of several people, a sequence's own truth does not say whose it is
        self.truth = read_truth(source.truth) if source.truth and job.people == 1 else None
        self.colours = ColourFolder(job.colour, source.intrinsics, numbers) if job.colour else None
        first = source.frame(numbers[0])
        self.configuration = run_configuration(job.sequence, first, numbers, self.asked(), job.given)

    def announce(self, done: int) -> str:
        """The frames, how many there are, and how they are tracked; or where a resumed run goes on."""
        job, total, camera = self.job, self.total, self.source.intrinsics
        if done and done == total:
            return f"all {total} frames are recorded in {job.out}; writing the results"
        if done:
            return f"going on with frame {self.numbers[done]}; {done} of {total} are recorded"
        if job.resume:
            return f"nothing to resume in {job.out}; beginning anew"
        how = f"{job.settings.method}, {counted(job.settings.filter.particles, 'particle')}"
        how += f", up to {job.people} people" if job.people > 1 else ""
        frames = f"{counted(len(self.numbers), 'frame')} ({camera.width}x{camera.height})"
        return f"tracking {frames} of {job.sequence} into {job.out}: {how}"

    def streams(self, workers: Workers, done: int) -> Iterator[Iterator[DepthFrame]]:
        """One stream: each frame from the first that is not recorded."""
        del workers
        yield map(self.source.frame, self.numbers[done:])

    def note(self) -> str:
        """Nothing to add to the progress after a frame."""
        return ""

    def facts(self) -> dict[str, object]:
        """Where the colour frames are that results are drawn over."""
        return {"color": None if self.job.colour is None else str(self.job.colour)}


class LiveInput(Input):
    """Frames that are published: the newest is tracked. InputError for what only a recording can have."""

    total = None  # frames

    def __init__(self, job: Job, key: str, show: Show) -> None:
        for option, given in (
            ("--frames", job.frames is not None),
            ("--resume", job.resume),
            ("--color", job.colour is not None),
            ("--joint-states", job.joint_states is not None),
            ("--intrinsics", job.given.intrinsics is not None),
            ("--depth-scale", job.given.depth_scale is not None),
        ):
            if given:
                raise InputError(f"{option} is for recorded sequences; leave it out with live input")
        if job.pool.listen is None and job.pool.connect is None:
            raise InputError("nobody could publish to this; add --listen or --connect with an endpoint")
        self.key, self._show = check_stream(key, guarded=job.pool.security is not None), show
        super().__init__(replace(job, settings=keep_up(job.settings)), None)
        self.received = LiveFrames(self.key, show.say, idle=job.idle_timeout)
        self.configuration = live_run_configuration(str(job.sequence), self.asked())

    def streams(self, workers: Workers, done: int) -> Iterator[Iterator[DepthFrame]]:
        """The newest frames until the publisher ends, of each stream from the first that shows depth."""
        del done
        workers.listen(self.key, self.received.receive)
        how = "the newest frame is tracked as soon as the workers are ready"
        self._show.say(f"listening on {self.key}; {how}")
        for _, frames in groupby(self.received, lambda _: self.received.stream):
            yield from_first_seen(map(self._fitting, frames), self._show.say)

    def _fitting(self, frame: DepthFrame) -> DepthFrame:
        """A frame; InputError where the room without people is of another size."""
        room, camera = self.scope.background, frame.intrinsics
        if room is not None and room.shape != frame.depth.shape:
            sizes = f"{room.shape[1]}x{room.shape[0]}, the stream {camera.width}x{camera.height}"
            raise InputError(f"--background {self.job.background} is {sizes}")
        return frame

    def note(self) -> str:
        """How many frames a newer one superseded."""
        return f", {self.received.counts.skipped} frames skipped"

    def facts(self) -> dict[str, object]:
        """What became of the messages."""
        return {f"frames_{name}": count for name, count in asdict(self.received.counts).items()}


def choose_start(
    init: str | None, source: Source | None, dof_names: Sequence[str] = HUMAN_DOFS
) -> Mapping[str, float] | None:
    """The pose to start from: of a file, else of the file that comes with the sequence, else to be found."""
    if init is None and source is not None and source.init is not None:
        return read_start(source.init, dof_names, "; is --model right? --init auto leaves this file out")
    return None if init in (None, AUTOMATIC) else read_start(Path(init), dof_names)
