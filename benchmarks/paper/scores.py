"""Scores of a row from its runs."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.matrix import Row
from benchmarks.paper.runs import Run
from common.settings import Settings
from coordinator.results.evaluation import LOST_M, Errors, lost_from, to_the_end
from coordinator.tracking.observing.sensor_noise import SensorNoise

Array = NDArray[np.float64]

SETTLED = {"clean": 10, "turn": 0}  # frames that do not count: tracking starts with a wrong pose
USUALLY_SETTLED = 30
NEAR_DEG = 10.0
LIMBS = [
    (f"{side}_{middle}", f"{side}_{end}")
    for side in ("right", "left")
    for middle, end in (("elbow", "wrist"), ("knee", "ankle"))
]


class Limbs(msgspec.Struct, frozen=True):
    """Mean joint error in centimetres, of joints that the camera sees and of those that it does not."""

    all_cm: float
    visible_cm: float
    hidden_cm: float


class RunScore(msgspec.Struct, frozen=True):
    """One run; errors in degrees, means over frames and angles."""

    seed: int
    reported_deg: float
    best_deg: float
    within_10_deg_percent: float  # frames whose reported pose is that near on average
    lost_from_frame: int | None
    limb_lost_from_frame: int | None
    ms_per_frame: float
    joints: Limbs | None = None


class RowScore(msgspec.Struct, frozen=True):
    """A row: every seed counts the same."""

    name: str
    part: str
    scene: str
    noise: SensorNoise
    settings: Settings  # of the first seed
    evaluations: int  # a frame
    frames: int
    from_frame: int  # on which errors count
    reported_deg: float
    best_deg: float
    reported_deg_by_angle: dict[str, float]
    within_10_deg_percent: float
    lost: int  # runs
    limb_lost: int  # runs in which an arm or a leg was never found again
    ms_per_frame: float
    hypotheses: float
    joints: Limbs | None
    runs: list[RunScore]


def score_row(row: Row, runs: Sequence[Run], visible: NDArray[np.bool_] | None) -> RowScore:
    """The score of a row; `visible` (F, J) where it is known which joints the camera sees."""
    first = SETTLED.get(row.part, USUALLY_SETTLED)
    scores = [score_run(run, first, visible) for run in runs]
    by_angle = np.mean([np.array(run.reported_deg)[first:].mean(axis=0) for run in runs], axis=0)
    return RowScore(
        name=row.name,
        part=row.part,
        scene=row.scene,
        noise=row.noise,
        settings=row.settings(0),
        evaluations=row.evaluations,
        frames=row.frames,
        from_frame=first,
        reported_deg=mean([s.reported_deg for s in scores]),
        best_deg=mean([s.best_deg for s in scores]),
        reported_deg_by_angle=dict(zip(runs[0].angles, by_angle.round(3).tolist(), strict=True)),
        within_10_deg_percent=mean([s.within_10_deg_percent for s in scores]),
        lost=sum(s.lost_from_frame is not None for s in scores),
        limb_lost=sum(s.limb_lost_from_frame is not None for s in scores),
        ms_per_frame=mean([s.ms_per_frame for s in scores]),
        hypotheses=mean([float(np.mean(run.hypotheses)) for run in runs]),
        joints=average([s.joints for s in scores if s.joints is not None]),
        runs=scores,
    )


def score_run(run: Run, first: int, visible: NDArray[np.bool_] | None) -> RunScore:
    """The score of one run from frame `first` on; lost is judged over all frames."""
    reported, best = np.array(run.reported_deg), np.array(run.best_deg)
    joint_cm = np.array(run.joint_cm)
    errors = Errors(np.arange(len(reported)), run.angles, reported, best, joint_cm / 100.0)
    return RunScore(
        seed=run.seed,
        reported_deg=round(float(reported[first:].mean()), 3),
        best_deg=round(float(best[first:].mean()), 3),
        within_10_deg_percent=round(100.0 * float(np.mean(reported[first:].mean(axis=1) <= NEAR_DEG)), 2),
        lost_from_frame=lost_from(errors),
        limb_lost_from_frame=limb_lost_from(run.joints, errors),
        ms_per_frame=round(float(np.mean(run.ms)), 2),
        joints=None if visible is None else limbs(joint_cm[first:], visible[first : len(joint_cm)]),
    )


def limb_lost_from(joints: tuple[str, ...], errors: Errors) -> int | None:
    """First frame from which on an arm or a leg is lost to the end, its two joints far off on average."""
    pairs = [[joints.index(name) for name in limb] for limb in LIMBS]
    far = [to_the_end(errors.frame, errors.joint_m[:, pair].mean(axis=1) > LOST_M) for pair in pairs]
    return min((frame for frame in far if frame is not None), default=None)


def limbs(joint_cm: Array, visible: NDArray[np.bool_]) -> Limbs:
    """Errors (F, J) of joints that are seen (F, J), and of the others."""
    return Limbs(
        all_cm=round(float(joint_cm.mean()), 3),
        visible_cm=round(float(joint_cm[visible].mean()), 3),
        hidden_cm=round(float(joint_cm[~visible].mean()), 3),
    )


def average(scores: Sequence[Limbs]) -> Limbs | None:
    """The mean of several runs."""
    if not scores:
        return None
    return Limbs(
        mean([s.all_cm for s in scores]),
        mean([s.visible_cm for s in scores]),
        mean([s.hidden_cm for s in scores]),
    )


def mean(values: Sequence[float]) -> float:
    """To three decimals."""
    return round(float(np.mean(values)), 3)
