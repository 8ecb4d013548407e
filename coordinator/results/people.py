"""The recorders of a run, one for each person, and the summary that several people share.

The results of one person alone are in the run's own folder; each of several people has a folder in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from common.errors import InputError
from coordinator.files import LOG_FILE, write_json
from coordinator.pool.options import PoolStatistics
from coordinator.results.configuration import RunConfiguration
from coordinator.results.log import Entry, Recorded, read_records
from coordinator.results.recorder import RESULTS, Recorder, check_configuration
from coordinator.results.summary import (
    FOUND,
    PEOPLE,
    PERSON,
    SUMMARY_FILE,
    count_doubts,
    count_status,
    find_summary,
    summarise,
)
from coordinator.tracking.reporting import Tracked
from coordinator.tracking.state import TrackerState

OF_ONE = (PERSON, "doubts", "rotate_deg", "noise_m")  # what differs from person to person


def folder_of(run: Path, people: int, number: int) -> Path:
    """Where a person's results are; people count from 1."""
    return run if people == 1 else run / f"{PERSON}{number}"


def of_all(configuration: RunConfiguration, people: int) -> RunConfiguration:
    """The configuration of a run of so many people."""
    return configuration if people == 1 else {**configuration, PEOPLE: people}


def was_found(recorded: Recorded) -> bool:
    """Whether a person was there at any time."""
    return recorded.state.start.found


def is_complete(run: Path, configuration: RunConfiguration, people: int = 1) -> bool:
    """Whether a folder holds a whole run; InputError if it was made under another configuration."""
    if people == 1 and ((run / LOG_FILE).exists() or not all((run / name).exists() for name in RESULTS)):
        return False
    summary = find_summary(run)
    if summary is None:
        return False
    check_configuration(run, summary, of_all(configuration, people))
    return summary.get("complete") is True


@dataclass(frozen=True, slots=True, eq=False)
class Recorders:
    """The recorders of all people of a run, the first person's first."""

    run: Path
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
        found: dict[int, Recorded] = {}
        for number, own in enumerate(self.recorders, start=1):
            recorded = own.read()
            if recorded is not None and (number == 1 or was_found(recorded)):
                found[number] = recorded
                rate = rate or len(recorded.estimates) / max(recorded.seconds, 1e-9)
                summary = {**facts, "frame_rate": rate, **summarise(recorded)}
                own.finish(recorded, summary, complete=complete)
            elif recorded is not None and complete:
                own.discard()
        if found and len(self.recorders) > 1:
            facts = {**facts, "frame_rate": rate}
            write_json(self.run / SUMMARY_FILE, summarise_all(found, facts, len(self.recorders)))
        return found


@contextmanager
def open_recorders(
    run: Path, configuration: RunConfiguration, people: int, *, resume: bool
) -> Iterator[Recorders]:
    """Recorders into a run's folders; InputError if what is there cannot be continued."""
    if people > 1 and not resume and (run / SUMMARY_FILE).exists():
        raise InputError(f"{run} holds an earlier run; choose another --out or delete what is there")
    folders = [folder_of(run, people, number) for number in range(1, people + 1)]
    common = min(count_frames(folder / LOG_FILE) for folder in folders) if resume and people > 1 else None
    with ExitStack() as stack:
        recorders = []
        for number, folder in enumerate(folders, start=1):
            own = {**of_all(configuration, people), **({PERSON: number} if people > 1 else {})}
            recorders.append(stack.enter_context(Recorder(folder, own, resume=resume, frames=common)))
        yield Recorders(run, recorders)


def count_frames(log: Path) -> int:
    """How many frames a log holds; 0 where there is none."""
    if not log.exists():
        return 0
    with log.open("rb") as file:
        return sum(isinstance(record, Entry) for record, _ in read_records(file))


def summarise_all(
    found: Mapping[int, Recorded], facts: Mapping[str, object], people: int
) -> dict[str, object]:
    """What the runs of those who were found, by number, have in common, and who they are."""
    first = next(iter(found.values()))
    common = {name: value for name, value in summarise(first).items() if name not in OF_ONE}
    status = [estimate.status for each in found.values() for estimate in each.estimates]
    return {
        **facts,
        **common,
        "model": first.configuration["model"],
        PEOPLE: people,
        "status": count_status(status),
        FOUND: [describe_person(number, each) for number, each in found.items()],
    }


def describe_person(number: int, recorded: Recorded) -> dict[str, object]:
    """One person in the summary of all."""
    estimates, start = recorded.estimates, recorded.state.start
    seen = [estimate.frame for estimate in estimates if estimate.status not in ("absent", "searching")]
    return {
        "folder": f"{PERSON}{number}",
        "first_frame_tracked": seen[0] if seen else None,
        "stature_m": start.stature if start.found else None,
        "girth": start.girth if start.found else None,
        "status": count_status(e.status for e in estimates),
        "doubts": count_doubts(estimates),
    }
