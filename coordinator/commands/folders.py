"""The folders of a run, one for each person: recorded frame by frame, written at the end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from coordinator.commands.job import Job
from coordinator.exports.tables import write_csv
from coordinator.files import write_atomically
from coordinator.pool.options import PoolStatistics
from coordinator.results import people, recorder
from coordinator.results.configuration import RunConfiguration
from coordinator.results.log import Recorded
from coordinator.results.recorder import CSV_FILE, Recorder
from coordinator.results.summary import summarise
from coordinator.results.track import MODEL_FILE, TrackedBody, write_tracked_body
from coordinator.tracking.state import TrackerState
from coordinator.tracking.tracker import Tracked


def folder_of(job: Job, number: int) -> Path:
    """Where a person's results are; people count from 1. One alone has the run's own folder."""
    return job.out if job.people == 1 else people.person_folder(job.out, number)


def is_complete(job: Job, configuration: RunConfiguration) -> bool:
    """Whether all frames were tracked before; InputError if that was under another configuration."""
    if job.people == 1:
        return recorder.is_complete(job.out, configuration)
    return people.is_complete(job.out, configuration, job.people)


@dataclass(frozen=True, slots=True, eq=False)
class Folders:
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
        return [each.past.state for each in self.recorders if each.past is not None] or None

    def append(self, tracked: Sequence[Tracked], statistics: PoolStatistics, seconds: float) -> None:
        """Record a frame of all people."""
        for own, each in zip(self.recorders, tracked, strict=True):
            own.append(each.estimate, each.state, statistics, seconds)

    def finish(self, facts: Mapping[str, object], rate: float) -> dict[int, Recorded]:
        """Write all files but pictures of those who were found, and of the first; gives these by number.

        Each summary begins with `facts`, whether all is complete among them, and the frame rate, frames
        a second; 0 where no frame was tracked now. Nothing is written before the first frame.
        """
        complete = bool(facts["complete"])
        read = {number: own.read() for number, own in enumerate(self.recorders, start=1)}
        found: dict[int, Recorded] = {}
        for number, recorded in read.items():
            own = self.recorders[number - 1]
            if recorded is not None and (number == 1 or people.was_found(recorded)):
                found[number] = recorded
                rate = rate or len(recorded.estimates) / max(recorded.seconds, 1e-9)
                write_results(own, recorded, {**facts, "frame_rate": rate}, complete=complete)
            elif recorded is not None and complete:
                own.discard()
        if found and self.job.people > 1:
            facts = {**facts, "frame_rate": rate}
            people.write_people_summary(self.job.out, found, facts, len(self.recorders))
        return found


def write_results(own: Recorder, recorded: Recorded, facts: Mapping[str, object], *, complete: bool) -> None:
    """Write all files of one person's run but the pictures."""
    body = TrackedBody(recorded.state.start.model, recorded.state.start.held)
    write_atomically(own.folder / MODEL_FILE, lambda file: write_tracked_body(body, file))
    track = own.finish(recorded, {**facts, **summarise(recorded)}, complete=complete)
    write_atomically(own.folder / CSV_FILE, lambda file: write_csv(track, file))


@contextmanager
def open_folders(job: Job, configuration: RunConfiguration) -> Iterator[Folders]:
    """The folders of all people, to record into; InputError if they cannot be gone on with."""
    if job.people == 1:
        with Recorder(job.out, configuration, resume=job.resume) as own:
            yield Folders(job, [own])
        return
    if not job.resume:
        people.refuse_earlier(job.out)
    common = people.frames_in_common(job.out, job.people) if job.resume else None
    with ExitStack() as stack:
        recorders = [
            stack.enter_context(
                Recorder(
                    folder_of(job, number),
                    people.of_person(configuration, job.people, number),
                    resume=job.resume,
                    frames=common,
                )
            )
            for number in range(1, job.people + 1)
        ]
        yield Folders(job, recorders)
