"""What `summary.json` says about a run: everything that was decided, and how it went."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import msgspec
import numpy as np

from common.errors import InputError
from coordinator.results.configuration import versions
from coordinator.tracking.estimate import UNKNOWN, Estimate, Status

if TYPE_CHECKING:  # it brings the compiler, which takes long to load
    from coordinator.results.log import Recorded

STATUSES = get_args(Status)
SUMMARY_FILE = "summary.json"
PEOPLE, PERSON = "people", "person"  # in it: how many were requested, and which of them this is
FOUND = "found"  # in the summary of several: one entry for each person who was found


def summarise(recorded: Recorded) -> dict[str, object]:
    """Configuration, versions, body, workers, frames and the time each stage took in all, in seconds."""
    configuration, start, statistics = recorded.configuration, recorded.state.start, recorded.statistics
    settings = configuration["settings"]
    particles = settings["filter"]["particles"]
    answered = [e.particles_answered for e in recorded.estimates if e.particles_answered]
    stages: dict[str, float] = {}
    for estimate in recorded.estimates:
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
            "stature_m": start.stature if start.found else None,
            "girth": start.girth if start.found else None,
            "active": start.model.dof_names,
        },
        "noise_m": {"depth": start.noise.depth, "lateral": start.noise.lateral},
        "versions": versions(),
        "resumes": recorded.resumes,
        "workers_seen": statistics.workers_seen,
        "local_workers_restarted": statistics.local_workers_restarted,
        "batches_sent": statistics.batches_sent,
        "batches_sent_again": statistics.batches_sent_again,
        "batches_refused": statistics.batches_refused,
        "replies_malformed": statistics.replies_malformed,
        "frames": len(recorded.estimates),
        "status": count_status(e.status for e in recorded.estimates),
        "doubts": count_doubts(recorded.estimates),
        "rotate_deg": round(np.degrees(start.way_up)),
        "particles": particles,
        "particles_unanswered": sum(particles - count for count in answered),
        "seconds": recorded.seconds,
        "time_per_stage": stages,
    }


def count_status(statuses: Iterable[str]) -> dict[str, int]:
    """Frames by status."""
    counts = Counter(statuses)
    return {status: counts[status] for status in STATUSES}


def count_doubts(estimates: Iterable[Estimate]) -> dict[str, int]:
    """What speaks against the poses of frames that are not tracked, and of how many, most first."""
    counts = Counter[str](e.why for e in estimates if e.why and e.status != "tracked")
    return dict(counts.most_common())


def mostly_tracked(estimates: Sequence[Estimate]) -> bool:
    """Whether half of the frames or more are, be it ambiguously."""
    return 2 * sum(e.status in UNKNOWN for e in estimates) <= len(estimates)


def describe_status(statuses: Iterable[str]) -> str:
    """How many frames have each status that occurs, in words."""
    return ", ".join(f"{n} {status}" for status, n in count_status(statuses).items() if n)


def describe_failure(estimates: Sequence[Estimate]) -> str:
    """What to say of a run of which most frames are not tracked, and why, where that is known."""
    doubts = count_doubts(estimates)
    why = f": {next(iter(doubts))}" if doubts else ""
    return f"most frames are not tracked ({describe_status(e.status for e in estimates)}){why}"


def find_summary(run: Path) -> dict[str, Any] | None:
    """What `gepf track` wrote beside the track; None if it is missing or damaged."""
    try:
        return msgspec.json.decode((run / SUMMARY_FILE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError):
        return None


def read_summary(run: Path) -> dict[str, Any]:
    """What `gepf track` wrote beside the track; InputError if it is missing or damaged."""
    summary = find_summary(run)
    if summary is None:
        raise InputError(
            f"{run} holds no {SUMMARY_FILE} that can be read; give the --out folder of a finished gepf track"
        )
    return summary


def people_in(run: Path) -> list[Path]:
    """The folders of the people who were found in a run; none where it is of a single person."""
    return [run / each["folder"] for each in (find_summary(run) or {}).get(FOUND, [])]
