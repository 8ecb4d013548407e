"""The content of `summary.json`: all settings of a run, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from gepf.common.errors import InputError
from gepf.coordinator.files import SUMMARY_FILE
from gepf.coordinator.results.configuration import RunConfiguration, digest_of, versions
from gepf.coordinator.results.tally import STATUSES, Outcome

if TYPE_CHECKING:  # it loads Zenoh, which is slow
    from gepf.coordinator.pool.options import PoolStatistics

PERSON_FILE = "person.json"  # the estimated size, for --model
PERSON = "person"  # key in the summary: number of the person
FOUND = "found"  # key in the summary of several people: one entry per person
OF_ONE = ("cameras", "doubts", "rotate_deg", "noise_m")  # entries that differ between people


def folder_of(run: Path, people: int, number: int) -> Path:
    """The folder of a person's results; numbers start at 1. A single person has the folder of the run."""
    return run if people == 1 else run / f"{PERSON}{number}"


@dataclass(frozen=True, slots=True, eq=False)
class RunTotals:
    """What all people of a run have in common."""

    configuration: RunConfiguration
    statistics: PoolStatistics
    seconds: float
    resumes: int = 0


def summarise(totals: RunTotals, person: Outcome) -> dict[str, object]:
    """Configuration, versions, body, workers, frames, and the total time of each stage in seconds."""
    configuration, start, statistics = totals.configuration, person.start, totals.statistics
    settings, tally, body = configuration["settings"], person.tally, start.body_of(person.shape)
    return {
        **configuration,
        "digest": digest_of(configuration),
        "method": settings["method"],
        "preset": settings["preset"],
        "seed": settings["seed"],
        "model": {
            **configuration["model"],
            "hash": body.hash,
            **describe_size(person),
            "active": body.dof_names,
        },
        "noise_m": {"depth": start.noise.depth, "lateral": start.noise.lateral},
        "versions": versions(),
        "resumes": totals.resumes,
        "workers_seen": statistics.workers_seen,
        "processors": statistics.processors,
        **statistics.counts,
        "frames": tally.frames,
        "status": tally.status,
        "doubts": dict(tally.doubts.most_common()),
        **tally.describe_cameras(),
        "rotate_deg": round(np.degrees(start.roll)),
        "particles": settings["filter"]["particles"],
        "seconds": totals.seconds,
        "time_per_stage": tally.stage_seconds,
    }


def summarise_all(totals: RunTotals, people: Mapping[int, Outcome]) -> dict[str, object]:
    """The common part of the summaries of several people, and an entry for each, by number."""
    common = summarise(totals, people[1])
    return {
        **{name: value for name, value in common.items() if name not in OF_ONE},
        "model": totals.configuration["model"],
        "status": {name: sum(each.tally.statuses[name] for each in people.values()) for name in STATUSES},
        FOUND: [describe_person(number, person) for number, person in people.items()],
    }


def describe_person(number: int, person: Outcome) -> dict[str, object]:
    """One person in the summary of all."""
    return {
        "folder": f"{PERSON}{number}",
        "first_frame_tracked": person.tally.first_tracked,
        **describe_size(person),
        "status": person.tally.status,
        "doubts": dict(person.tally.doubts.most_common()),
    }


def describe_size(person: Outcome) -> dict[str, float | None]:
    """Measures by name, such as stature, girth and age; None if the body was not found."""
    start = person.start
    return start.family.describe_size(start.size_of(person.shape), person.stature_deviation)


def find_summary(run: Path) -> dict[str, Any] | None:
    """The summary of a run; None if it is missing or damaged."""
    try:
        return msgspec.json.decode((run / SUMMARY_FILE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError):
        return None


def read_summary(run: Path) -> dict[str, Any]:
    """The summary of a run; InputError if it is missing or damaged."""
    summary = find_summary(run)
    if summary is None:
        raise InputError(f"{run} has no readable {SUMMARY_FILE}; give the --out of a finished gepf track")
    return summary


def people_in(run: Path) -> list[Path]:
    """The folders of the people who were found in a run; empty for a run of a single person."""
    return [run / each["folder"] for each in (find_summary(run) or {}).get(FOUND, [])]
