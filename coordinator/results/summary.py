"""The content of `summary.json`: all settings of a run, and its outcome."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import msgspec
import numpy as np

from gepf.common.errors import InputError
from gepf.coordinator.bodies.human.shape_space import shape_space
from gepf.coordinator.files import SUMMARY_FILE
from gepf.coordinator.results.configuration import versions
from gepf.coordinator.tracking.estimate import Estimate, Status

if TYPE_CHECKING:  # it loads the compiler, which is slow
    from gepf.coordinator.results.log import Recorded, RecordedPerson
    from gepf.coordinator.tracking.state import TrackerState

STATUSES = get_args(Status)
PERSON_FILE = "person.json"  # the estimated size, for --model
PERSON = "person"  # key in the summary: number of the person
FOUND = "found"  # key in the summary of several people: one entry per person
OF_ONE = ("cameras", "doubts", "rotate_deg", "noise_m")  # differs between people


def folder_of(run: Path, people: int, number: int) -> Path:
    """The folder of a person's results; numbers start at 1. A single person has the folder of the run."""
    return run if people == 1 else run / f"{PERSON}{number}"


def summarise(recorded: Recorded, person: RecordedPerson) -> dict[str, object]:
    """Configuration, versions, body, workers, frames, and the total time of each stage in seconds."""
    configuration, start, statistics = recorded.configuration, person.state.start, recorded.statistics
    settings = configuration["settings"]
    stages: dict[str, float] = {}
    for estimate in person.estimates:
        for stage, seconds in estimate.stage_seconds.items():
            stages[stage] = stages.get(stage, 0.0) + seconds
    return {
        **configuration,
        "method": settings["method"],
        "preset": settings["preset"],
        "seed": settings["seed"],
        "model": {
            **configuration["model"],
            "hash": start.model.hash,
            **describe_size(person.state),
            "active": start.model.dof_names,
        },
        "noise_m": {"depth": start.noise.depth, "lateral": start.noise.lateral},
        "versions": versions(),
        "resumes": recorded.resumes,
        "workers_seen": statistics.workers_seen,
        **statistics.counts,
        "frames": len(person.estimates),
        "status": count_status(e.status for e in person.estimates),
        "doubts": count_doubts(person.estimates),
        **describe_cameras(person.estimates),
        "rotate_deg": round(np.degrees(start.roll)),
        "particles": settings["filter"]["particles"],
        "seconds": recorded.seconds,
        "time_per_stage": stages,
    }


def summarise_all(recorded: Recorded, found: Mapping[int, RecordedPerson]) -> dict[str, object]:
    """The common part of the summaries of several people, and an entry for each, by number."""
    common = summarise(recorded, recorded.people[0])
    return {
        **{name: value for name, value in common.items() if name not in OF_ONE},
        "model": recorded.configuration["model"],
        "status": count_status(each.status for person in found.values() for each in person.estimates),
        FOUND: [describe_person(number, person) for number, person in found.items()],
    }


def describe_person(number: int, person: RecordedPerson) -> dict[str, object]:
    """One person in the summary of all."""
    estimates = person.estimates
    seen = [estimate.frame for estimate in estimates if estimate.status not in ("absent", "searching")]
    return {
        "folder": f"{PERSON}{number}",
        "first_frame_tracked": seen[0] if seen else None,
        **describe_size(person.state),
        "status": count_status(e.status for e in estimates),
        "doubts": count_doubts(estimates),
    }


def describe_size(state: TrackerState) -> dict[str, float | None]:
    """Stature, its standard deviation, girth and age by proportions; None if nobody was detected."""
    stature, girth, maturity = state.start.size
    size = (stature, state.stature_deviation, girth, shape_space().age(stature, maturity))
    names = ("stature_m", "stature_deviation_m", "girth", "age")
    return dict(zip(names, size if state.start.found else (None,) * len(names), strict=True))


def count_status(statuses: Iterable[str]) -> dict[str, int]:
    """Frames by status."""
    counts = Counter(statuses)
    return {status: counts[status] for status in STATUSES}


def count_doubts(estimates: Iterable[Estimate]) -> dict[str, int]:
    """Reasons to doubt frames that are not tracked, with the number of frames, the most frequent first."""
    counts = Counter[str](e.why for e in estimates if e.why and e.status != "tracked")
    return dict(counts.most_common())


def describe_cameras(estimates: Sequence[Estimate]) -> dict[str, object]:
    """For each camera of a rig the frames in which it showed the body, and its faults."""
    faults: dict[str, dict[tuple[str, float], float]] = {}  # until when
    shown = Counter(name for each in estimates for name in each.seen_by if name)
    for each in estimates:
        for name, (kind, since_s) in each.faults.items():
            faults.setdefault(name, {})[kind, since_s] = each.time_s
    cameras = {
        name: {
            "frames_shown": shown[name],
            "faults": [
                {"fault": kind, "from_s": round(since_s, 3), "to_s": round(until_s, 3)}
                for (kind, since_s), until_s in faults.get(name, {}).items()
            ],
        }
        for name in sorted({*shown, *faults})
    }
    return {"cameras": cameras} if cameras else {}


def describe_status(statuses: Iterable[str]) -> str:
    """Number of frames of each status that occurs, as text."""
    return ", ".join(f"{n} {status}" for status, n in count_status(statuses).items() if n)


def describe_failure(estimates: Sequence[Estimate]) -> str:
    """Message about a run in which most frames are not tracked, with the reason if it is known."""
    doubts = count_doubts(estimates)
    why = f": {next(iter(doubts))}" if doubts else ""
    return f"most frames are not tracked ({describe_status(e.status for e in estimates)}){why}"


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
        raise InputError(f"{run} holds no readable {SUMMARY_FILE}; give the folder of a finished gepf track")
    return summary


def people_in(run: Path) -> list[Path]:
    """The folders of the people who were found in a run; empty for a run of a single person."""
    return [run / each["folder"] for each in (find_summary(run) or {}).get(FOUND, [])]
