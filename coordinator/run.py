"""One run from its options to its files: read, track, record, draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coordinator.atomic_file import write_atomically
from coordinator.chosen_body import HUMAN_DOFS, choose_bodies
from coordinator.model_file import MODEL_FILE, TrackedBody, write_model
from coordinator.options import AUTOMATIC, Job, Pool
from coordinator.progress import FrameMeter, Show
from coordinator.recorder import Recorder
from coordinator.refiner import Refiner
from coordinator.sources import Source, open_source
from coordinator.sources.source import check_frames, select_frames
from coordinator.start_file import read_start
from coordinator.summary import summarise
from coordinator.track import read_track
from coordinator.tracker import Tracker
from coordinator.traffic import Traffic
from coordinator.truth import Truth, read_truth


class PooledRefiner(Refiner, Protocol):
    """A refiner that can tell who did the work."""

    @property
    def traffic(self) -> Traffic:
        """Workers and batches so far."""
        ...


Connect = Callable[[Pool, Show], AbstractContextManager[PooledRefiner]]


@dataclass(frozen=True, slots=True)
class Run:
    """What one run works with."""

    job: Job
    source: Source
    numbers: range
    tracker: Tracker
    refiner: PooledRefiner
    recorder: Recorder


def track_sequence(job: Job, show: Show, connect: Connect) -> None:
    """Do a `gepf track`. All input is checked before the folder of results is made.

    If it ends early, by the user or by a fault, the frames so far are in the folder all the same.
    """
    source = open_source(job.sequence)
    numbers = select_frames(source.numbers, job.frames)
    bodies = choose_bodies(job.active, job.settings.preset)
    start = choose_start(job.init, source)
    truth = read_truth(source.truth) if source.truth else None
    with show.steps("reading frames") as advance:
        check_frames(source, numbers, advance)
    with Recorder(job.out) as recorder, connect(job.pool, show) as refiner:
        tracker = Tracker(refiner, job.settings, bodies, start)
        run = Run(job, source, numbers, tracker, refiner, recorder)
        meter = show.frames(len(numbers))
        try:
            with meter:
                follow(run, meter)
        finally:
            finish(run, meter, show)
    draw(run, truth, show)


def choose_start(init: str | None, source: Source) -> Mapping[str, float] | None:
    """The pose to start from: of a file, else of the file that comes with the sequence, else to be found."""
    path = source.init if init is None else None if init == AUTOMATIC else Path(init)
    return None if path is None else read_start(path, HUMAN_DOFS)


def follow(run: Run, meter: FrameMeter) -> None:
    """Track frame after frame; each is durable before the next begins."""
    for number in run.numbers:
        estimate = run.tracker.track(run.source.frame(number))
        if not run.recorder.frames:
            run.recorder.open_with(run.tracker.model.dof_names, run.tracker.model.joint_names)
        run.recorder.append(estimate)
        meter.advance(estimate)


def finish(run: Run, meter: FrameMeter, show: Show) -> None:
    """Write the final files of what was recorded, be it all or not."""
    if not run.recorder.frames:
        return
    complete = run.recorder.frames == len(run.numbers)
    estimates = run.recorder.estimates()
    summary = summarise(run.job, run.tracker.start, estimates, run.refiner.traffic)
    timing = {"complete": complete, "seconds": meter.seconds, "frame_rate": meter.rate}
    body = TrackedBody(run.tracker.model, run.tracker.start.held)
    write_atomically(run.job.out / MODEL_FILE, lambda file: write_model(body, file))
    run.recorder.finish(timing | summary, complete=complete)
    if not complete:
        show.say(f"ended early; the first {len(estimates)} frames are in {run.job.out}")


def draw(run: Run, truth: Truth | None, show: Show) -> None:
    """Pictures of a finished run."""
    from coordinator.pictures import draw_run

    track = read_track(run.job.out)
    show.say("drawing pictures")
    files = draw_run(run.source, run.tracker.model, track, run.job.out, truth)
    show.say(f"{len(track.frame)} frames and {len(files)} pictures are in {run.job.out}")
