"""All that was measured, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from benchmarks.costs.timing import machine
from benchmarks.paper.bound import Bound
from benchmarks.paper.scores import RowScore
from coordinator.results.configuration import versions
from coordinator.tracking.observing.sensor_noise import SensorNoise


class Bounds(msgspec.Struct, frozen=True):
    """What the arm's noisy frames allow: least mean absolute errors."""

    noise: SensorNoise
    single_frame: list[Bound]
    filtered: Bound  # all frames so far, the motion known as one of random accelerations
    smoothed: Bound  # all frames


class Report(msgspec.Struct, frozen=True):
    """One run of the benchmark."""

    versions: dict[str, str]
    machine: dict[str, str]
    processes: int
    seeds: list[int]  # of noise and tracker; each row tells how many of them it has
    bounds: Bounds | None
    rows: list[RowScore]
    crashes: dict[str, str]


def report(
    rows: Sequence[RowScore], bounds: Bounds | None, processes: int, crashes: Mapping[str, str]
) -> Report:
    """Put together what was measured."""
    seeds = sorted({run.seed for row in rows for run in row.runs})
    return Report(versions(), machine(), processes, seeds, bounds, list(rows), dict(crashes))
