"""What each change is worth: paired differences from the unchanged preset, with their interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.ablation.trials import Trial

SURE = 0.95  # of an interval
Share = Literal["percent", "raw_percent"]


class Difference(msgspec.Struct, frozen=True):
    """Points of per cent by which a change is better than the unchanged preset, and its interval of 95 %."""

    mean: float
    low: float
    high: float

    @property
    def shows(self) -> bool:
        """Whether the interval leaves zero out."""
        return not self.low <= 0.0 <= self.high


class Effect(msgspec.Struct, frozen=True):
    """What came of one row, means over recordings of their means over seeds."""

    row: str
    percent: float
    raw_percent: float
    ms_per_frame: float
    difference: Difference | None  # None for the unchanged preset, and for a single recording
    raw_difference: Difference | None


def effects_of(trials: Sequence[Trial], rows: Sequence[str]) -> list[Effect]:
    """An effect for each row; the first one is the unchanged preset."""
    return [effect(trials, row, rows[0]) for row in rows]


def effect(trials: Sequence[Trial], row: str, unchanged: str) -> Effect:
    """What came of one row."""
    mine = [trial for trial in trials if trial.row == row]
    same = row == unchanged
    return Effect(
        row=row,
        percent=mean_of(means(trials, row, "percent")),
        raw_percent=mean_of(means(trials, row, "raw_percent")),
        ms_per_frame=round(float(np.mean([trial.ms_per_frame for trial in mine])), 1),
        difference=None if same else compare(trials, row, unchanged, "percent"),
        raw_difference=None if same else compare(trials, row, unchanged, "raw_percent"),
    )


def means(trials: Sequence[Trial], row: str, share: Share) -> dict[str, float]:
    """Recording -> mean over seeds."""
    found: dict[str, list[float]] = {}
    for trial in trials:
        if trial.row == row:
            found.setdefault(trial.recording, []).append(getattr(trial, share))
    return {recording: float(np.mean(values)) for recording, values in found.items()}


def mean_of(by_recording: dict[str, float]) -> float:
    """Every recording counts the same."""
    return round(float(np.mean(list(by_recording.values()))), 2)


def compare(trials: Sequence[Trial], row: str, unchanged: str, share: Share) -> Difference | None:
    """The mean over recordings of their paired differences, and its t interval; None for a single one."""
    mine, theirs = means(trials, row, share), means(trials, unchanged, share)
    if len(mine) < 2:
        return None
    return t_interval(np.array([mine[recording] - theirs[recording] for recording in mine]))


def t_interval(differences: NDArray[np.float64]) -> Difference:
    """Mean of paired differences (n,) and the interval that holds it with 95 %, by Student's t."""
    count, mean = len(differences), float(differences.mean())
    half = float(stats.t.ppf(0.5 + 0.5 * SURE, count - 1) * differences.std(ddof=1) / np.sqrt(count))
    return Difference(round(mean, 2), round(mean - half, 2), round(mean + half, 2))
