"""Several people of one recording: their folders, and the summary that they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from common.errors import InputError
from coordinator.files import LOG_FILE, write_atomically
from coordinator.results.configuration import RunConfiguration
from coordinator.results.log import Entry, Recorded, read_records
from coordinator.results.recorder import check_configuration
from coordinator.results.summary import (
    FOUND,
    PEOPLE,
    PERSON,
    SUMMARY_FILE,
    count_doubts,
    count_status,
    summarise,
)

OWN = (PERSON, "doubts", "rotate_deg", "noise_m")  # in the summary of one person


def person_folder(run: Path, number: int) -> Path:
    """Where the results of a person are, who are counted from 1."""
    return run / f"{PERSON}{number}"


def of_person(configuration: RunConfiguration, people: int, number: int) -> RunConfiguration:
    """The configuration of one person's run."""
    return {**configuration, PEOPLE: people, PERSON: number}


def frames_in_common(run: Path, people: int) -> int:
    """How many frames are recorded of every person."""
    return min(count_frames(person_folder(run, number + 1) / LOG_FILE) for number in range(people))


def count_frames(log: Path) -> int:
    """How many frames a log holds; 0 where there is none."""
    if not log.exists():
        return 0
    with log.open("rb") as file:
        return sum(isinstance(record, Entry) for record, _ in read_records(file))


def is_complete(run: Path, configuration: RunConfiguration, people: int) -> bool:
    """Whether a folder holds a whole run of people; InputError if it was made under another configuration."""
    try:
        summary = msgspec.json.decode((run / SUMMARY_FILE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError):
        return False
    check_configuration(run, summary, {**configuration, PEOPLE: people})
    return summary.get("complete") is True


def refuse_earlier(run: Path) -> None:
    """InputError where a folder holds results already."""
    if (run / SUMMARY_FILE).exists():
        raise InputError(f"{run} holds an earlier run; choose another --out or delete what is there")


def write_people_summary(
    run: Path, found: Mapping[int, Recorded], said: Mapping[str, object], people: int
) -> None:
    """Write what the runs of those who were found, by number, have in common, and who they are."""
    first = next(iter(found.values()))
    common = {name: value for name, value in summarise(first).items() if name not in OWN}
    status = sum((Counter(count_status(each.estimates)) for each in found.values()), Counter[str]())
    summary = {
        **said,
        **common,
        "model": first.configuration["model"],
        PEOPLE: people,
        "status": {name: status[name] for name in count_status(())},
        FOUND: [describe_person(number, each) for number, each in found.items()],
    }
    text = msgspec.json.format(msgspec.json.encode(summary), indent=2)
    write_atomically(run / SUMMARY_FILE, lambda file: file.write(text + b"\n"))


def describe_person(number: int, recorded: Recorded) -> dict[str, object]:
    """One person in the summary of all."""
    estimates, start = recorded.estimates, recorded.state.start
    seen = [estimate.frame for estimate in estimates if estimate.status not in ("absent", "searching")]
    return {
        "folder": f"{PERSON}{number}",
        "first_frame_tracked": seen[0] if seen else None,
        "stature_m": start.stature if start.found else None,
        "girth": start.girth if start.found else None,
        "status": count_status(estimates),
        "doubts": count_doubts(estimates),
    }


def was_found(recorded: Recorded) -> bool:
    """Whether a person was there at any time."""
    return recorded.state.start.found
