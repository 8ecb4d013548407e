"""The evidence about each joint of a recording as it is tracked, beside how far the joint was off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.certainty.cutting import cut_below, row_between
from benchmarks.frame_rates.reference import read_reference
from benchmarks.frame_rates.trials import read_frames
from benchmarks.sequences import Recording
from benchmarks.utd import JOINTS
from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.results.evaluation import positions, read_truth
from coordinator.tracking.certainty.evidence import weigh_evidence
from coordinator.tracking.estimate import UNKNOWN
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Gathered:
    """F tracked frames of one recording with J joints and K clues."""

    person: str  # whose constant offsets are removed; empty where the truth is exact
    performance: str  # recordings of the same one are fitted or scored together
    every: int
    lone: bool  # a single particle was drawn
    interval: Array  # (F,) seconds since the frame before
    evidence: Array  # (F, J, K)
    apart: Array  # (F, J, 3) metres from the reference
    holds: NDArray[np.bool_]  # (F, J) where the depth does not contradict the reference
    status: NDArray[np.str_]  # (F,)


def gather(
    recording: Recording, every: int, settings: Settings, bodies: Bodies, cut: float | None = None
) -> Gathered:
    """Track every n-th frame and gather what is said of the frames in which the body is known.

    cut: share of the way from knees to hips at which the picture ends; None for all of it.
    """
    frames = read_frames(recording)
    names, truth, holds = read_joints(recording, frames)
    if cut is not None:
        row = row_between(truth, names, cut, frames[0].intrinsics)
        frames = [cut_below(frame, row) for frame in frames]
    tracker = Tracker(DirectRefiner(), settings, bodies)
    rows: list[tuple[float, Array, Array, NDArray[np.bool_], str]] = []
    for frame in frames[::every]:
        tracked = tracker.collect(tracker.submit(frame))
        estimate, sighted = tracker.report(tracked).estimate, tracked.sighted
        if estimate.status in UNKNOWN or sighted is None or not np.isfinite(truth[frame.number]).all():
            continue
        mine = positions(tracker.model.joint_names, names)
        evidence = weigh_evidence(
            tracker.model, estimate.pose, estimate.hypothesis_pose, estimate.hypothesis_weight, sighted
        )
        off = estimate.joint_positions[mine] - truth[frame.number]
        rows.append((sighted.interval, evidence[mine], off, holds[frame.number], estimate.status))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    person = "" if recording.action is None else recording.name.rpartition("_")[2]
    lone = settings.filter.particles == 1
    return Gathered(person, performance_of(recording), every, lone, *columns)


def read_joints(
    recording: Recording, frames: Sequence[DepthFrame]
) -> tuple[tuple[str, ...], Array, NDArray[np.bool_]]:
    """Names (J,), joints (T, J, 3) of each frame, NaN where there are none, and which hold (T, J)."""
    if recording.action is None:
        truth = read_truth(recording.joints)
        names, joints = truth.joint_names, np.full((len(frames), len(truth.joint_names), 3), np.nan)
        joints[truth.frame] = truth.joint_positions
        return names, joints, np.ones(joints.shape[:2], dtype=bool)
    reference = read_reference(recording.joints, list(frames))
    there, found, held = reference.at(np.arange(len(frames)))
    joints, holds = np.full((len(frames), len(JOINTS), 3), np.nan), np.zeros((len(frames), len(JOINTS)), bool)
    joints[there], holds[there] = found, held
    return JOINTS, joints, holds


def performance_of(recording: Recording) -> str:
    """The action, or who danced, whatever the camera."""
    return recording.name.partition("_")[0]
