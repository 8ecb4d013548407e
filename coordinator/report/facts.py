"""A run's summary in words."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from coordinator.results.configuration.nested import flatten
from coordinator.results.track import Track
from coordinator.tracking.estimate import Status

Summary = dict[str, Any]


def describe_run(track: Track, summary: Summary) -> list[tuple[str, str]]:
    """What a reader wants to know first: names and values."""
    return [
        ("frames", f"{len(track.frame)} in {np.ptp(track.time_s):.1f} s"),
        ("status", describe_status(track)),
        ("body", describe_body(track, summary.get("model", {}))),
        ("method", describe_method(summary)),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", describe_service(summary)),
    ]


def describe_status(track: Track) -> str:
    """How many frames have each status that occurs."""
    count = {status: int((track.status == status).sum()) for status in get_args(Status)}
    return ", ".join(f"{number} {status}" for status, number in count.items() if number)


def describe_body(track: Track, model: Summary) -> str:
    """Its name, stature if it has one, and how much of it moves."""
    stature = f", {model['stature_m']:.2f} m tall" if model.get("stature_m") else ""
    return f"{model.get('name', 'unknown')}{stature}, {len(track.dof_names)} degrees of freedom"


def describe_method(summary: Summary) -> str:
    """Method, preset and number of particles."""
    method, preset, particles = (summary.get(key) for key in ("method", "preset", "particles"))
    return f"{method}, preset {preset}, particles: {particles}"


def describe_service(summary: Summary) -> str:
    """Who worked, and what had to be done again."""
    workers, sent = len(summary.get("workers_seen", [])), summary.get("batches_sent", 0)
    who = f"{workers} worker{'s' * (workers != 1)}"
    return f"{who}, {sent} batches, {summary.get('batches_sent_again', 0)} sent again"


def describe_stages(summary: Summary) -> list[tuple[str, float, float]]:
    """Stages, the seconds each took, and their share of the longest."""
    stages: dict[str, float] = summary.get("time_per_stage", {})
    longest = max(stages.values(), default=0.0) or 1.0
    return [(stage, seconds, seconds / longest) for stage, seconds in stages.items()]


def list_settings(settings: Summary) -> list[tuple[str, str]]:
    """Settings and their values, those of a group after its name and a dot."""
    return [(name, str(value)) for name, value in flatten(settings)]
