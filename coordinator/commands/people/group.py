"""The runs of several people side by side: recorded frame by frame, written at the end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

from coordinator.commands.console.progress import FrameMeter
from coordinator.commands.options.job import Job
from coordinator.commands.results_stream import open_results
from coordinator.commands.track import write_results
from coordinator.pool.statistics import PoolStatistics
from coordinator.results.configuration import RunConfiguration
from coordinator.results.live_results import LiveResults
from coordinator.results.log import Recorded
from coordinator.results.people import (
    frames_in_common,
    of_person,
    person_folder,
    refuse_earlier,
    was_found,
    write_people_summary,
)
from coordinator.results.recorder import Recorder
from coordinator.results.summary import PERSON
from coordinator.tracking.people.crowd import Crowd
from coordinator.tracking.people.pipeline import Results
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.state import TrackerState


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The recorders of all people of a run, the first person's first."""

    job: Job
    recorders: Sequence[Recorder]

    @property
    def frames(self) -> int:
        """How many are recorded, of each person."""
        return self.recorders[0].frames

    @property
    def states(self) -> list[TrackerState] | None:
        """What was known of each person after the last of them; None before the first."""
        past = [recorder.past for recorder in self.recorders]
        return [each.state for each in past if each is not None] or None

    def append(self, results: Results, statistics: PoolStatistics, seconds: float) -> None:
        """Record a frame of all."""
        for recorder, (estimate, state) in zip(self.recorders, results, strict=True):
            recorder.append(estimate, state, statistics, seconds)

    def read(self) -> dict[int, Recorded]:
        """What is recorded, by the person's number; nothing before the first frame."""
        read = {number: recorder.read() for number, recorder in enumerate(self.recorders, start=1)}
        return {number: recorded for number, recorded in read.items() if recorded is not None}

    def finish(self, said: Mapping[str, object], *, complete: bool) -> dict[int, Recorded]:
        """Write the files of all who were found, and of the first in any case; gives these by number."""
        recorded = self.read()
        found = {number: each for number, each in recorded.items() if number == 1 or was_found(each)}
        for number, each in found.items():
            write_results(self.recorders[number - 1], each, said, complete=complete)
        if found:
            write_people_summary(self.job.out, found, said, len(self.recorders))
        if complete:
            for number in recorded.keys() - found.keys():
                self.recorders[number - 1].discard()
        return found


@contextmanager
def open_group(job: Job, configuration: RunConfiguration) -> Iterator[Group]:
    """The folders of all people, to record into; InputError if they cannot be gone on with."""
    if not job.resume:
        refuse_earlier(job.out)
    common = frames_in_common(job.out, job.people) if job.resume else None
    with ExitStack() as stack:
        recorders = [
            stack.enter_context(
                Recorder(
                    person_folder(job.out, number),
                    of_person(configuration, job.people, number),
                    resume=job.resume,
                    frames=common,
                )
            )
            for number in range(1, job.people + 1)
        ]
        yield Group(job, recorders)


@contextmanager
def open_all_results(job: Job, refiner: Refiner) -> Iterator[list[LiveResults | None]]:
    """Where each person's estimates are published: the key that was asked for, and who it is."""
    with ExitStack() as stack:
        keys = [f"{job.results}/{PERSON}{number + 1}" for number in range(job.people)]
        asked = [replace(job, results=key if job.results else None) for key in keys]
        yield [stack.enter_context(open_results(each, refiner)) for each in asked]


def put_all(results: Results, crowd: Crowd, outlets: Sequence[LiveResults | None]) -> None:
    """Publish a frame's estimates of all who are found."""
    for (estimate, _), follower, outlet in zip(results, crowd.followers, outlets, strict=True):
        if outlet is not None and follower.start.found:
            outlet.put(estimate, follower.model, follower.start.held)


def advance(meter: FrameMeter, results: Results, note: str = "") -> None:
    """One frame more: the first person in full, of the others the status."""
    estimates = [estimate for estimate, _ in results]
    others = "".join(f"; person {n} {e.status}" for n, e in enumerate(estimates[1:], start=2))
    meter.advance(estimates[0], others + note)
