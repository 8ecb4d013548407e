"""What `summary.json` says about a run: everything that was decided, and how it went."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import get_args

import msgspec

from coordinator.estimate import Estimate, Status
from coordinator.options import Job
from coordinator.start import Start
from coordinator.traffic import Traffic

PACKAGES = ("gepf", "eclipse-zenoh", "msgpack", "msgspec", "numba", "numpy", "open3d", "scipy")
STATUSES = get_args(Status)


def summarise(job: Job, start: Start, estimates: Sequence[Estimate], traffic: Traffic) -> dict[str, object]:
    """Settings, seed, versions, body, workers, frames and the time each stage took in all, in seconds."""
    return {
        "sequence": job.sequence.resolve().name,
        "method": job.settings.method,
        "preset": job.settings.preset,
        "seed": job.settings.seed,
        "settings": msgspec.to_builtins(job.settings),
        "model": {
            "name": job.model,
            "hash": start.model.hash,
            "stature_m": start.stature,
            "girth": start.girth,
            "active": start.model.dof_names,
        },
        "versions": versions(),
        "workers_seen": traffic.workers_seen,
        "local_workers_restarted": traffic.local_workers_restarted,
        "batches_sent": traffic.batches_sent,
        "batches_sent_again": traffic.batches_sent_again,
        "batches_refused": traffic.batches_refused,
        "replies_malformed": traffic.replies_malformed,
        "frames": len(estimates),
        "status": count_status(estimates),
        "particles": job.settings.filter.particles,
        "time_per_stage": add_stages(estimates),
    }


def versions() -> dict[str, str]:
    """Of Python and of the packages that decide results; what is not installed is left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def count_status(estimates: Iterable[Estimate]) -> dict[str, int]:
    """Frames by status."""
    counts = Counter[str](estimate.status for estimate in estimates)
    return {status: counts[status] for status in STATUSES}


def add_stages(estimates: Iterable[Estimate]) -> dict[str, float]:
    """Seconds of the whole run by stage, in the order in which the stages first came."""
    total: dict[str, float] = {}
    for estimate in estimates:
        for stage, seconds in estimate.stage_seconds.items():
            total[stage] = total.get(stage, 0.0) + seconds
    return total
