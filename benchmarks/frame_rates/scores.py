"""Scores of many trials, and their table."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from benchmarks.frame_rates.trials import Compared
from coordinator.results.evaluation import NEAR_M

Array = NDArray[np.float64]


class Marks(msgspec.Struct, frozen=True):
    """Of joints: per cent within 10 cm, and the mean distance in cm; raw, and without offsets."""

    raw_percent: float
    raw_cm: float
    offset_removed_percent: float
    offset_removed_cm: float


class RowScore(msgspec.Struct, frozen=True):
    """One row at one frame rate, mean over the seeds."""

    row: str
    frames_per_second: float
    frames: int  # of one seed
    all_joints: Marks
    uncontradicted: Marks  # joints whose reference the depth does not contradict
    uncontradicted_share: float  # of all joints
    by_seed: list[float]  # uncontradicted, within 10 cm, offset removed, per cent
    ms_per_frame: float
    crashes: list[str]


def score_row(
    row: str, frames_per_second: float, seeds: Sequence[Sequence[Compared]], crashes: list[str]
) -> RowScore:
    """The score of the trials of each seed."""
    whole = [mark(trials, held=False) for trials in seeds]
    held = [mark(trials, held=True) for trials in seeds]
    frames = sum(len(one.raw) for one in seeds[0])
    return RowScore(
        row=row,
        frames_per_second=frames_per_second,
        frames=frames,
        all_joints=average(whole),
        uncontradicted=average(held),
        uncontradicted_share=round(float(np.mean(gather(seeds[0], "holds"))), 4),
        by_seed=[one.offset_removed_percent for one in held],
        ms_per_frame=round(1e3 * sum(one.seconds for one in seeds[0]) / max(1, frames), 1),
        crashes=crashes,
    )


def mark(trials: Sequence[Compared], *, held: bool) -> Marks:
    """Every joint of every frame counts the same; if `held`, only where the reference holds."""
    raw, removed = gather(trials, "raw"), gather(trials, "offset_removed")
    if held:
        holds = gather(trials, "holds").astype(bool)
        raw, removed = raw[holds], removed[holds]
    return Marks(near_percent(raw), mean_cm(raw), near_percent(removed), mean_cm(removed))


def gather(trials: Sequence[Compared], field: str) -> Array:
    """All numbers of a field in one row."""
    return np.concatenate([np.empty(0), *(getattr(one, field).ravel() for one in trials)])


def near_percent(distances: Array) -> float:
    """Share within 10 cm, per cent."""
    return round(100.0 * float(np.mean(distances <= NEAR_M)), 2)


def mean_cm(distances: Array) -> float:
    """Mean in centimetres."""
    return round(100.0 * float(np.mean(distances)), 2)


def average(marks: Sequence[Marks]) -> Marks:
    """Mean over the seeds."""
    table = np.array([msgspec.structs.astuple(one) for one in marks])
    return Marks(*(round(float(value), 2) for value in table.mean(axis=0)))


def score_table(scores: Sequence[RowScore], title: str) -> Table:
    """A line for each row and frame rate; raw stands first."""
    table = Table(title=title)
    for heading in (
        "frames/s", "row", "raw\n<10 cm", "\ncm", "offset removed\n<10 cm", "\ncm",
        "uncontradicted\nraw <10 cm", "\ncm", "offset removed\n<10 cm", "by seed", "ms/frame",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading in ("row", "by seed") else "right")
    for one in scores:
        whole, held = one.all_joints, one.uncontradicted
        table.add_row(
            f"{one.frames_per_second:g}",
            one.row,
            *(f"{v:.1f}" for v in msgspec.structs.astuple(whole)),
            f"{held.raw_percent:.1f}",
            f"{held.raw_cm:.1f}",
            f"{held.offset_removed_percent:.1f}",
            " ".join(f"{v:.1f}" for v in one.by_seed),
            f"{one.ms_per_frame:.0f}",
        )
    return table
