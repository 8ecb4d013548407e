"""One person or several: what the options ask for, and who does it."""

from __future__ import annotations

from common.errors import InputError
from coordinator.bodies.human.dofs import HUMAN
from coordinator.commands.console.progress import Show
from coordinator.commands.options.choices import at_least
from coordinator.commands.options.job import Job
from coordinator.commands.track import track_sequence
from coordinator.commands.track_live import track_stream
from coordinator.commands.workers import Connect, ListeningRefiner, PooledRefiner
from coordinator.results.configuration import AUTOMATIC


def choose_people(asked: int, model: str, init: str | None) -> int:
    """How many are tracked at the most; InputError for what is meant for one body."""
    at_least(1, "--people", asked)
    if asked > 1 and model != HUMAN:
        raise InputError("--people is for people whose measures are found; leave out --model")
    if asked > 1 and init not in (None, AUTOMATIC):
        raise InputError("--init is the pose of one person; with --people all are found, so leave it out")
    return asked


def track_recording(job: Job, show: Show, connect: Connect[PooledRefiner]) -> bool:
    """Do a `gepf track` of a recording; gives whether most of its frames were tracked."""
    if job.people == 1:
        return track_sequence(job, show, connect)
    from coordinator.commands.people.track import track_people

    return track_people(job, show, connect)


def track_live(job: Job, show: Show, connect: Connect[ListeningRefiner]) -> bool:
    """Do a `gepf track` of live input; gives whether most of its frames were tracked."""
    if job.people == 1:
        return track_stream(job, show, connect)
    from coordinator.commands.people.live import track_people_live

    return track_people_live(job, show, connect)
