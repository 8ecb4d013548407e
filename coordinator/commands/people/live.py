"""Live input with several people: the newest frame is tracked, and recorded, until the stream ends."""

from __future__ import annotations

from dataclasses import asdict, replace

from common.errors import InputError
from coordinator.bodies.choice import choose_bodies
from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import Show
from coordinator.commands.garbage import leave_loaded_alone
from coordinator.commands.options.job import Job
from coordinator.commands.people.group import Group, advance, open_all_results, open_group, put_all
from coordinator.commands.people.track import conclude
from coordinator.commands.track import describe_pool
from coordinator.commands.track_live import MEND_STREAM, check_live, until_interrupted
from coordinator.commands.workers import Connect, ListeningRefiner
from coordinator.results.configuration import live_run_configuration
from coordinator.scene.scope import Scope
from coordinator.sources.live import LiveFrames, from_first_seen
from coordinator.tracking.observing.isolation import prepare
from coordinator.tracking.pace import keep_up
from coordinator.tracking.people.crowd import Crowd


def track_people_live(job: Job, show: Show, connect: Connect[ListeningRefiner]) -> bool:
    """Do a `gepf track zenoh:KEY --people N`. An interrupt ends the stream as its publisher does.

    Gives whether all who were found were tracked most of the time. Raises InputError if the stream ends
    before a frame came.
    """
    key, job = check_live(job), replace(job, settings=keep_up(job.settings))
    scope = job.scope.read(None)
    asked = job.asked(choose_bodies(job.active, job.settings.preset), None, scope)
    frames = LiveFrames(key, show.say, idle=job.idle_timeout)
    with open_group(job, live_run_configuration(str(job.sequence), asked)) as group:
        rate, complete = 0.0, False
        try:
            with until_interrupted(group.recorders[0]):
                rate = track_newest(group, key, frames, scope, show, connect)
            complete = True
        finally:
            counts = {f"frames_{name}": count for name, count in asdict(frames.counts).items()}
            said = {"complete": complete, "frame_rate": rate, "pool": describe_pool(job.pool), **counts}
            found = group.finish(said, complete=complete)
        if not found:
            raise InputError(f"no depth came on {key} before the stream's end; {MEND_STREAM}")
    return conclude(found, job, show)


def track_newest(
    group: Group,
    key: str,
    frames: LiveFrames,
    scope: Scope,
    show: Show,
    connect: Connect[ListeningRefiner],
) -> float:
    """Track whatever frame is the newest; gives the frame rate."""
    job, meter = group.job, show.frames(None)
    bodies = choose_bodies(job.active, job.settings.preset)
    with connect(job.pool, show) as refiner, meter, open_all_results(job, refiner) as outlets:
        prepare()  # so that no frame has to wait for it
        refiner.listen(key, frames.receive)
        show.say(f"listening on {key}; the newest frame is tracked as soon as the workers are ready")
        crowd = Crowd(refiner, job.settings, bodies, job.people, scope)
        for frame in leave_loaded_alone(from_first_seen(iter(frames), show.say)):
            results = [
                (estimate, follower.state)
                for estimate, follower in zip(crowd.track(frame), crowd.followers, strict=True)
            ]
            put_all(results, crowd, outlets)
            advance(meter, results, f", {frames.counts.skipped} frames skipped")
            group.append(results, refiner.statistics, meter.seconds)
            INTERRUPTS.check()
    return meter.rate
