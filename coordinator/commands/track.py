"""`gepf track`, recorded or live, one person or several: track each frame, publish, record, draw."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from common.errors import InputError, SilentWorkers
from coordinator.commands.console import DONE, INTERRUPTS, NOT_TRACKED, end_as_interrupted
from coordinator.commands.finished import draw_pictures
from coordinator.commands.inputs import MEND_STREAM, LiveInput, RecordedInput
from coordinator.commands.job import Job, choose_job, is_several
from coordinator.commands.progress import FrameMeter, Show, counted
from coordinator.commands.track_options import TrackOptions
from coordinator.commands.workers import Connect, Workers
from coordinator.files import HYPOTHESES_FILE
from coordinator.pool.options import Pool
from coordinator.results.live_results import LiveResults
from coordinator.results.log import RecordedPerson
from coordinator.results.recorder import Recorder, is_complete
from coordinator.results.summary import (
    PERSON,
    SUMMARY_FILE,
    describe_failure,
    describe_status,
    folder_of,
    mostly_tracked,
)
from coordinator.results.track import filled, read_track, read_tracked_body
from coordinator.sources.live import live_key
from coordinator.tracking.reporting import Tracked
from coordinator.tracking.tracker import Tracker

Frames = RecordedInput | LiveInput

RECONNECTIONS = 3  # to workers that are there and do not answer
LOADING_FRAMES = 2  # while which a run loads what it needs


def run_track(options: TrackOptions, show: Show, connect: Connect) -> int:
    """Track; gives the exit code. Raises InputError for options that make no sense, before anything is read.

    Several recordings or seeds are tracked side by side, each into a folder of its own.
    """
    job = choose_job(options)
    end_as_interrupted()
    if is_several(options.input.sequences, options.method.seeds):
        from coordinator.commands.many import track_recordings

        return track_recordings(options, job, show)
    tracked = track(job, show, connect)
    if options.output.as_json:
        sys.stdout.write((job.out / SUMMARY_FILE).read_text(encoding="utf-8"))
    return DONE if tracked else NOT_TRACKED


def track(job: Job, show: Show, connect: Connect) -> bool:
    """Track recorded or live input; gives whether all who were found were tracked in most frames.

    The folder of results is made when the options and the first recorded frame are sound. If the run ends
    early, by the user, a damaged frame or another fault, the frames so far are in the folder all the same,
    and another run with `resume` goes on from there. An interrupt ends live input as its publisher does.
    Where all workers fall silent, the run goes on over a new connection, a few times.
    """
    key = live_key(job.sequence)
    given = RecordedInput(job) if key is None else LiveInput(job, key, show)
    if job.resume and is_complete(job.out, given.configuration):
        show.say(f"all {given.total} frames are in {job.out} already")
        return True
    for attempts_left in reversed(range(RECONNECTIONS + 1)):
        try:
            with Recorder(job.out, given.configuration, resume=job.resume) as recorder:
                recorded = record(given, recorder, show, connect, again=attempts_left > 0)
            break
        except SilentWorkers:
            if not attempts_left or given.total is None:
                raise
            show.say(
                "workers are there, and none of them answers; connecting anew: this run goes on by itself"
            )
            job = given.job = replace(job, resume=True)
    if isinstance(given, LiveInput) and not recorded:
        raise InputError(f"no depth came on {given.key} before the stream's end; {MEND_STREAM}")
    draw(given, recorded, show)
    return conclude(job, recorded, show)


def record(
    given: Frames, recorder: Recorder, show: Show, connect: Connect, *, again: bool
) -> dict[int, RecordedPerson]:
    """Track what is not recorded yet, and write the files of what then is, however that ends."""
    job = given.job
    meter = show.frames(given.total, recorder.frames)
    if isinstance(given, RecordedInput):
        show.say(given.announce(recorder.frames))
    ended = False
    try:
        if recorder.frames != given.total:
            track_frames(given, recorder, meter, show, connect, again=again)
        ended = True
    except KeyboardInterrupt:
        if given.total is not None or not recorder.frames:
            raise
        INTERRUPTS.forget()  # the end of live input
        ended = True
    finally:
        complete = ended if given.total is None else recorder.frames == given.total
        facts = {"complete": complete, "pool": describe_pool(job.pool), **given.facts()}
        recorded = recorder.finish(facts, meter.rate)
        if recorded and not complete and given.total is not None:
            kept = max(len(each.estimates) for each in recorded.values())  # as in the log, whenever it ended
            show.say(
                f"ended early with {kept} of {given.total} frames in {job.out}; "
                "the same command with --resume goes on"
            )
    return recorded


def track_frames(
    given: Frames,
    recorder: Recorder,
    meter: FrameMeter,
    show: Show,
    connect: Connect,
    *,
    again: bool,
) -> None:
    """Track frame after frame; each is recorded while the workers are busy with the next.

    Tracking starts anew with each stream of live input, where no frame is read ahead.
    """
    job, look_ahead = given.job, isinstance(given, RecordedInput)
    with connect(job.pool, show) as workers, meter, open_results(job, workers, again=again) as outlets:
        make = partial(
            Tracker,
            workers,
            job.settings,
            given.bodies,
            people=job.people,
            scope=given.scope,
            start=given.start,
            motion=given.motion,
            states=recorder.states,
        )
        if not look_ahead:
            make().prepare()  # so that no frame has to wait for it
        streams = given.streams(workers, recorder.frames)
        run = (each for frames in streams for each in make().follow(frames, look_ahead=look_ahead))
        for tracked in leave_loaded_alone(run):
            for each, outlet in zip(tracked, outlets, strict=False):
                start = each.state.start
                if job.people == 1 or start.found:
                    outlet.put(each.estimate, start.model, start.held)
            others = "".join(f"; person {n} {each.estimate.status}" for n, each in enumerate(tracked[1:], 2))
            meter.advance(tracked[0].estimate, others + given.note())
            recorder.append(tracked, workers.statistics, meter.seconds)
            INTERRUPTS.check()


@contextmanager
def open_results(job: Job, workers: Workers, *, again: bool) -> Iterator[list[LiveResults]]:
    """Where estimates are published, one outlet a person; none if that is not wanted. Their end is, too.

    again: Whether the run connects anew where all workers fall silent, so that this is not the end.
    """
    if job.results is None:
        yield []
        return
    keys = [job.results]
    if job.people > 1:
        keys = [f"{job.results}/{PERSON}{number}" for number in range(1, job.people + 1)]
    outlets = [LiveResults(workers.speak(key), as_json=job.results_json) for key in keys]
    goes_on = False
    try:
        yield outlets
    except SilentWorkers:
        goes_on = again
        raise
    finally:
        if not goes_on:
            for outlet in outlets:
                outlet.end()


def leave_loaded_alone(run: Iterable[list[Tracked]]) -> Iterator[list[Tracked]]:
    """Keep what the first frames loaded out of garbage collections, which would take 0.1 s each."""
    try:
        for step, each in enumerate(run):
            if step < LOADING_FRAMES:
                gc.freeze()
            yield each
    finally:
        gc.unfreeze()


def describe_pool(pool: Pool) -> dict[str, object]:
    """Who was asked to refine, as the command line has it; certificates and keys stay unnamed."""
    pool = pool.requested or pool
    return {
        "workers": pool.workers,
        "listen": pool.listen,
        "connect": pool.connect,
        "worker_timeout": pool.worker_timeout,
        "encrypted": pool.security is not None,
    }


def draw(given: Frames, recorded: Mapping[int, RecordedPerson], show: Show) -> None:
    """Pictures of a finished run; of live input, whose frames were not kept, of the hypotheses alone."""
    job = given.job
    for number, each in recorded.items():
        out, status = (
            folder_of(job.out, job.people, number),
            describe_status(e.status for e in each.estimates),
        )
        frames = counted(len(each.estimates), "frame")
        if isinstance(given, LiveInput):
            frames = f"{len(each.estimates)} of {given.received.counts.received} frames"
            if job.pictures:
                from coordinator.pictures.plots import draw_hypotheses

                track = filled(read_track(out))
                draw_hypotheses(track, read_tracked_body(out), None, out / HYPOTHESES_FILE)
            show.say(f"{frames} were tracked; results are in {out}: {status}")
            continue
        assert isinstance(given, RecordedInput)
        if not job.pictures:
            show.say(f"{frames} are in {out}: {status}; gepf pictures {out} draws them")
            continue
        try:
            body = read_tracked_body(out)
            files = draw_pictures(given.source, body, read_track(out), out, show, given.truth, given.colours)
        except KeyboardInterrupt:
            show.say(f"{frames} are in {out}, without pictures; gepf pictures {out} draws them")
            raise
        show.say(f"{frames} and {counted(len(files), 'picture')} are in {out}: {status}")


def conclude(job: Job, recorded: Mapping[int, RecordedPerson], show: Show) -> bool:
    """Warn of those who mostly are not tracked; gives whether all are tracked.

    Of several people, the first has a run even where none was found.
    """
    several = job.people > 1
    if several:
        there = sum(person.found for person in recorded.values())
        if there < job.people:
            show.say(f"{there} of up to {job.people} people were found")
    tracked = True
    for number, each in recorded.items():
        # one of several may come and go
        seen = [e for e in each.estimates if not several or e.status != "absent"]
        if not seen or not mostly_tracked(seen):
            tracked = False
            why = describe_failure(each.estimates)
            show.warn(f"person {number}: {why}" if several else why)
    return tracked
