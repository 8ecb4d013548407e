"""One run from its options to its files: read, track, record, draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from common.errors import SilentWorkers
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.dofs import HUMAN_DOFS
from coordinator.bodies.tracked import Bodies
from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import FrameMeter, Show, counted
from coordinator.commands.finished.pictures import draw_pictures
from coordinator.commands.garbage import leave_loaded_alone
from coordinator.commands.options.job import Job
from coordinator.commands.results_stream import open_results
from coordinator.commands.workers import Connect, PooledRefiner
from coordinator.exports.tables import write_csv
from coordinator.files import write_atomically
from coordinator.pool.options import Pool
from coordinator.results.configuration import AUTOMATIC, run_configuration
from coordinator.results.evaluation import Truth, read_truth
from coordinator.results.log import Recorded
from coordinator.results.recorder import CSV_FILE, Recorder, is_complete
from coordinator.results.summary import (
    describe_failure,
    describe_status,
    mostly_tracked,
    summarise,
)
from coordinator.results.track import MODEL_FILE, TrackedBody, read_track, write_tracked_body
from coordinator.scene.scope import Scope
from coordinator.sources import Source, open_source
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.source import select_frames
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.pipeline import follow
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.starting.start_file import read_start

RECONNECTIONS = 3  # to workers that are there and do not answer


@dataclass(frozen=True, slots=True)
class Run:
    """What one run works with."""

    job: Job
    source: Source
    numbers: Sequence[int]
    bodies: Bodies
    start: Mapping[str, float] | None
    scope: Scope
    recorder: Recorder
    colours: ColourFolder | None = None
    again: bool = False  # whether another connection is tried if all workers fall silent


class Record(Protocol):
    """Records a run; with `resume` from where it was left, with `again` not for the last time."""

    def __call__(self, *, resume: bool, again: bool) -> tuple[Run, Recorded | None]:
        """Give the run, and what there is of it."""
        ...


def track_sequence(job: Job, show: Show, connect: Connect[PooledRefiner]) -> bool:
    """Do a `gepf track`. The folder of results is made when the options and the first frame are sound.

    Later frames are read when it is their turn. If the run ends early, by the user, a damaged frame or
    another fault, the frames so far are in the folder all the same, and another one with `resume` goes on
    from there. Gives whether the body was tracked in most frames.
    """
    source = open_source(job.sequence, job.given)
    numbers = select_frames(source.numbers, job.frames)
    bodies = choose_bodies(job.active, job.settings.preset, job.model)
    start = choose_start(job.init, source, bodies.dof_names)
    if job.joint_states is not None:
        job.joint_states.check_names(bodies.dof_names)
    truth = read_truth(source.truth) if source.truth else None
    colours = ColourFolder(job.colour, source.intrinsics, numbers) if job.colour else None
    first = source.frame(numbers[0])
    scope = job.scope.read(source, job.settings.rotate_deg)
    asked = job.asked(bodies, start, scope)
    configuration = run_configuration(job.sequence, first, numbers, asked, job.given)
    if job.resume and is_complete(job.out, configuration):
        show.say(f"all {len(numbers)} frames are in {job.out} already")
        return True

    def record(*, resume: bool, again: bool) -> tuple[Run, Recorded | None]:
        with Recorder(job.out, configuration, resume=resume) as recorder:
            run = Run(job, source, numbers, bodies, start, scope, recorder, colours, again)
            return run, record_frames(run, show, connect, resume=resume)

    run, recorded = connecting_anew(record, show, resume=job.resume)
    if recorded is None:
        return True
    draw(run, recorded, truth, show)
    return conclude(recorded, show)


def connecting_anew(record: Record, show: Show, *, resume: bool) -> tuple[Run, Recorded | None]:
    """Record a run; where all workers fall silent, go on from there over a new connection, a few times."""
    for _ in range(RECONNECTIONS):
        try:
            return record(resume=resume, again=True)
        except SilentWorkers:
            show.say(
                "workers are there, and none of them answers; connecting anew: this run goes on by itself"
            )
            resume = True
    return record(resume=resume, again=False)


def record_frames(run: Run, show: Show, connect: Connect[PooledRefiner], *, resume: bool) -> Recorded | None:
    """Track what is not recorded yet, and write the files of what then is, however that ends."""
    total, done = len(run.numbers), run.recorder.frames
    meter = show.frames(total, done)
    show.say(describe_resume(run) if resume else announce(run))
    try:
        if done < total:
            track_frames(run, meter, show, connect)
    finally:
        recorded = finish(run, meter, show)
    return recorded


def announce(run: Run) -> str:
    """What is about to be done."""
    job, camera = run.job, run.source.intrinsics
    size = f"{camera.width}x{camera.height}"
    how = f"{job.settings.method}, {counted(job.settings.filter.particles, 'particle')}"
    return f"tracking {counted(len(run.numbers), 'frame')} ({size}) of {job.sequence} into {job.out}: {how}"


def describe_resume(run: Run) -> str:
    """Where a resumed run goes on."""
    done, total = run.recorder.frames, len(run.numbers)
    if done == total:
        return f"all {total} frames are recorded in {run.job.out}; writing the results"
    if done:
        return f"going on with frame {run.numbers[done]}; {done} of {total} are recorded"
    return f"nothing to resume in {run.job.out}; beginning anew"


def choose_start(
    init: str | None, source: Source, dof_names: Sequence[str] = HUMAN_DOFS
) -> Mapping[str, float] | None:
    """The pose to start from: of a file, else of the file that comes with the sequence, else to be found."""
    if init is None and source.init is not None:
        return read_start(source.init, dof_names, "; is --model right? --init auto leaves this file out")
    return None if init in (None, AUTOMATIC) else read_start(Path(init), dof_names)


def track_frames(run: Run, meter: FrameMeter, show: Show, connect: Connect[PooledRefiner]) -> None:
    """Track frame after frame; each is recorded while the workers are busy with the next."""
    recorder = run.recorder
    with (
        connect(run.job.pool, show) as refiner,
        meter,
        open_results(run.job, refiner, again=run.again) as results,
    ):
        past = recorder.past.state if recorder.past else None
        isolation = Isolation(run.job.settings.points, run.scope)
        motion = KnownMotion(run.job.joint_states) if run.job.joint_states else None
        tracker = Tracker(refiner, run.job.settings, run.bodies, Known(run.start, past, motion), isolation)
        frames = (run.source.frame(number) for number in run.numbers[recorder.frames :])
        for estimate, state in leave_loaded_alone(follow(tracker, frames)):
            meter.advance(estimate)
            if results is not None:
                results.put(estimate, tracker.model, tracker.start.held)
            recorder.append(estimate, state, refiner.statistics, meter.seconds)
            INTERRUPTS.check()


def finish(run: Run, meter: FrameMeter, show: Show) -> Recorded | None:
    """Write the final files of what was recorded, be it all or not."""
    recorded = run.recorder.read()
    if recorded is None:
        return None
    count = len(recorded.estimates)
    complete = count == len(run.numbers)
    rate = meter.rate or count / max(recorded.seconds, 1e-9)
    colour = None if run.job.colour is None else str(run.job.colour)
    said = {"complete": complete, "frame_rate": rate, "pool": describe_pool(run.job.pool), "color": colour}
    write_results(run.recorder, recorded, said, complete=complete)
    if not complete:
        show.say(
            f"ended early with {count} of {len(run.numbers)} frames in {run.job.out}; "
            "the same command with --resume goes on"
        )
    return recorded


def describe_pool(pool: Pool) -> dict[str, object]:
    """Who was asked to refine, as the command line has it; certificates and keys stay unnamed."""
    pool = pool.asked or pool
    return {
        "workers": pool.workers,
        "listen": pool.listen,
        "connect": pool.connect,
        "worker_timeout": pool.worker_timeout,
        "encrypted": pool.security is not None,
    }


def write_results(
    recorder: Recorder, recorded: Recorded, said: Mapping[str, object], *, complete: bool
) -> None:
    """Write all files of a run but the pictures; the summary begins with what is `said`."""
    body = TrackedBody(recorded.state.start.model, recorded.state.start.held)
    write_atomically(recorder.folder / MODEL_FILE, lambda file: write_tracked_body(body, file))
    track = recorder.finish(recorded, {**said, **summarise(recorded)}, complete=complete)
    write_atomically(recorder.folder / CSV_FILE, lambda file: write_csv(track, file))


def conclude(recorded: Recorded, show: Show) -> bool:
    """Warn where most frames are not tracked; gives whether they are."""
    tracked = mostly_tracked(recorded.estimates)
    if not tracked:
        show.warn(describe_failure(recorded.estimates))
    return tracked


def draw(run: Run, recorded: Recorded, truth: Truth | None, show: Show) -> None:
    """Pictures of a finished run."""
    body = TrackedBody(recorded.state.start.model, recorded.state.start.held)
    out, frames = run.job.out, counted(len(run.numbers), "frame")
    if not run.job.pictures:
        show.say(f"{frames} are in {out}; gepf pictures {out} draws them")
        return
    try:
        files = draw_pictures(run.source, body, read_track(out), out, show, truth, run.colours)
    except KeyboardInterrupt:
        show.say(f"{frames} are in {out}, without pictures; gepf pictures {out} draws them")
        raise
    show.say(
        f"{frames} and {counted(len(files), 'picture')} are in {out}: {describe_status(recorded.estimates)}"
    )
