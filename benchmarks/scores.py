"""Scores of single recordings and of many: every joint of every frame counts the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.comparison import Comparison
from benchmarks.tracking import Tracked
from coordinator.results.evaluation import NEAR_M

Array = NDArray[np.float64]


class Accuracy(msgspec.Struct, frozen=True):
    """Of joints: how many are near, and how far they are on average."""

    within_10cm_percent: float
    mean_error_cm: float


class Marks(msgspec.Struct, frozen=True):
    """Accuracy of joints; None where there are none."""

    raw: Accuracy | None
    offset_removed: Accuracy | None  # without each joint's constant median offset in its recording
    visible: Accuracy | None  # raw, of joints that the camera sees, where that is known
    hidden: Accuracy | None  # and of the others


class RecordingScore(msgspec.Struct, frozen=True):
    """One recording."""

    sequence: str
    frames: int
    joints: Marks
    lost_from_frame: int | None
    status: dict[str, int]  # frames by what the tracker itself says
    mean_hypotheses: float
    mean_residual_mm: float
    stature_m: float
    girth: float
    ms_per_frame: float  # the first included, in which the start is sought
    ms_first_frame: float


class Score(msgspec.Struct, frozen=True):
    """Several recordings; those that crashed have no joints that could count, and so are named."""

    sequences: int
    frames: int
    joints: Marks
    worst: str | None  # by joints within 10 cm, raw or after offset removal as asked
    worst_percent: float | None
    mean_of_sequences_percent: float | None  # of the same, where every recording counts the same
    ms_per_frame: float | None
    lost: list[str]
    crashed: list[str]


def score_recording(name: str, tracked: Tracked) -> RecordingScore:
    """The score of one recording."""
    return RecordingScore(
        sequence=name,
        frames=len(tracked.seconds),
        joints=mark([tracked.comparison]),
        lost_from_frame=tracked.comparison.lost_from,
        status=tracked.status,
        mean_hypotheses=round(tracked.hypotheses, 2),
        mean_residual_mm=round(1e3 * tracked.residual, 2),
        stature_m=round(tracked.stature, 3),
        girth=tracked.girth,
        ms_per_frame=round(1e3 * float(tracked.seconds.mean()), 1),
        ms_first_frame=round(1e3 * float(tracked.seconds[0]), 1),
    )


def score(tracked: Mapping[str, Tracked], crashed: Sequence[str], *, raw: bool) -> Score:
    """The score of several recordings; `raw` tells by what the worst is found."""
    compared = {name: one.comparison for name, one in tracked.items()}
    near = {name: within(c.raw if raw else c.offset_removed) for name, c in compared.items()}
    worst = min(near, key=lambda name: near[name], default=None)
    seconds = pool([one.seconds for one in tracked.values()])
    return Score(
        sequences=len(tracked) + len(crashed),
        frames=len(seconds),
        joints=mark(list(compared.values())),
        worst=worst,
        worst_percent=None if worst is None else round(near[worst], 2),
        mean_of_sequences_percent=round(float(np.mean(list(near.values()))), 2) if near else None,
        ms_per_frame=round(1e3 * float(seconds.mean()), 1) if len(seconds) else None,
        lost=[name for name, c in compared.items() if c.lost_from is not None],
        crashed=list(crashed),
    )


def score_joints(compared: Sequence[Comparison]) -> dict[str, Marks]:
    """The accuracy of each joint; all recordings have the same joints."""
    names = compared[0].joint_names if compared else ()
    return {name: mark([c.only(name) for c in compared]) for name in names}


def mark(compared: Sequence[Comparison]) -> Marks:
    """The accuracy of all joints of all frames."""
    seen = [(c.raw, c.visible) for c in compared if c.visible is not None]
    return Marks(
        raw=accuracy(pool([c.raw for c in compared])),
        offset_removed=accuracy(pool([c.offset_removed for c in compared])),
        visible=accuracy(pool([raw[visible] for raw, visible in seen])),
        hidden=accuracy(pool([raw[~visible] for raw, visible in seen])),
    )


def pool(parts: Sequence[Array]) -> Array:
    """All numbers in one row."""
    return np.concatenate([np.empty(0), *(part.ravel() for part in parts)])


def accuracy(errors: Array) -> Accuracy | None:
    """Of distances in metres, of any shape; None if there are none."""
    if not errors.size:
        return None
    return Accuracy(round(within(errors), 2), round(100.0 * float(errors.mean()), 3))


def within(errors: Array) -> float:
    """Per cent of distances (metres, any shape) that are at most 10 cm."""
    return 100.0 * float(np.mean(errors <= NEAR_M))
