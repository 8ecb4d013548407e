"""One run on live input: track the newest frame, and record it, until the stream ends or is interrupted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from common.errors import InputError
from common.protocol.keys import check_stream
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.tracked import Bodies
from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import FrameMeter, Show
from coordinator.commands.garbage import leave_loaded_alone
from coordinator.commands.options.job import Job
from coordinator.commands.results_stream import open_results
from coordinator.commands.track import conclude, describe_pool, write_results
from coordinator.commands.workers import Connect, ListeningRefiner
from coordinator.files import HYPOTHESES_FILE
from coordinator.results.configuration import AUTOMATIC, live_run_configuration
from coordinator.results.log import Recorded
from coordinator.results.recorder import Recorder
from coordinator.results.track import filled, read_track, read_tracked_body
from coordinator.scene.scope import Scope
from coordinator.sources.live import LiveFrames, from_first_seen, live_key
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation, prepare
from coordinator.tracking.pace import keep_up
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.starting.start_file import read_start

MEND_STREAM = "is its publisher running, with this key and endpoint, and is its depth above 0?"


@dataclass(frozen=True, slots=True)
class LiveRun:
    """What one run works with."""

    job: Job
    key: str
    frames: LiveFrames
    bodies: Bodies
    start: Mapping[str, float] | None
    scope: Scope
    recorder: Recorder


def track_stream(job: Job, show: Show, connect: Connect[ListeningRefiner]) -> bool:
    """Do a `gepf track zenoh:KEY`. An interrupt ends the stream as its publisher does.

    Gives whether the body was tracked in most frames. Raises InputError if the stream ends before a frame
    came.
    """
    key, job = check_live(job), replace(job, settings=keep_up(job.settings))
    bodies = choose_bodies(job.active, job.settings.preset, job.model)
    start = None if job.init in (None, AUTOMATIC) else read_start(Path(job.init), bodies.dof_names)
    scope = job.scope.read(None, job.settings.rotate_deg)
    configuration = live_run_configuration(str(job.sequence), job.asked(bodies, start, scope))
    frames = LiveFrames(key, show.say, idle=job.idle_timeout)
    with Recorder(job.out, configuration) as recorder:
        run = LiveRun(job, key, frames, bodies, start, scope, recorder)
        meter, complete = show.frames(None), False
        try:
            with until_interrupted(recorder):
                track_newest(run, meter, show, connect)
            complete = True
        finally:
            recorded = finish(run, meter, complete=complete)
        if recorded is None or not recorder.frames:
            raise InputError(f"no depth came on {key} before the stream's end; {MEND_STREAM}")
    draw(run, show)
    return conclude(recorded, show)


def check_live(job: Job) -> str:
    """The key of the stream; InputError for options that only a recorded sequence can have."""
    key = live_key(job.sequence)
    if key is None:
        raise InputError(f"'{job.sequence}' is no live input; give zenoh:KEY")
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
    return check_stream(key, guarded=job.pool.security is not None)


@contextmanager
def until_interrupted(recorder: Recorder) -> Iterator[None]:
    """Let an interrupt end the body, if anything was recorded by then."""
    try:
        yield
    except KeyboardInterrupt:
        if not recorder.frames:
            raise
        INTERRUPTS.forget()


def track_newest(run: LiveRun, meter: FrameMeter, show: Show, connect: Connect[ListeningRefiner]) -> None:
    """Track whatever frame is the newest; each is recorded before the next begins."""
    with connect(run.job.pool, show) as refiner, meter, open_results(run.job, refiner) as results:
        prepare()  # so that no frame has to wait for it
        isolation = Isolation(run.job.settings.points, run.scope)
        tracker = Tracker(refiner, run.job.settings, run.bodies, Known(run.start), isolation)
        tracker.prepare()
        refiner.listen(run.key, run.frames.receive)
        show.say(f"listening on {run.key}; the newest frame is tracked as soon as the workers are ready")
        for frame in leave_loaded_alone(from_first_seen(iter(run.frames), show.say)):
            estimate = tracker.track(frame)
            if results is not None:
                results.put(estimate, tracker.model, tracker.start.held)
            meter.advance(estimate, f", {run.frames.counts.skipped} frames skipped")
            run.recorder.append(estimate, tracker.state, refiner.statistics, meter.seconds)
            INTERRUPTS.check()


def finish(run: LiveRun, meter: FrameMeter, *, complete: bool) -> Recorded | None:
    """Write the final files of what was recorded."""
    recorded = run.recorder.read()
    if recorded is None:
        return None
    counts = {f"frames_{name}": count for name, count in asdict(run.frames.counts).items()}
    pool = describe_pool(run.job.pool)
    said = {"complete": complete, "frame_rate": meter.rate, "pool": pool, **counts}
    write_results(run.recorder, recorded, said, complete=complete)
    return recorded


def draw(run: LiveRun, show: Show) -> None:
    """The hypotheses of a finished run; the frames themselves were not kept."""
    out = run.job.out
    track = read_track(out)
    if run.job.pictures:
        from coordinator.pictures.hypotheses import draw_hypotheses

        draw_hypotheses(filled(track), read_tracked_body(out), None, out / HYPOTHESES_FILE)
    show.say(f"{len(track.frame)} of {run.frames.counts.received} frames were tracked; results are in {out}")
