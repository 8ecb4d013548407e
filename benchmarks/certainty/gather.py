"""The evidence about each joint of a recording as it is tracked, beside how far the joint was off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.certainty.cutting import cut_below, row_between
from benchmarks.recordings import Recording, read_frames, read_reference
from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.results.evaluation import positions
from coordinator.tracking.certainty.evidence import weigh_evidence
from coordinator.tracking.estimate import UNKNOWN
from coordinator.tracking.loop import Stopwatch
from coordinator.tracking.segmenter import Segmenter
from coordinator.tracking.target import TargetTracker
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
    segmenter, tracker = Segmenter(settings.points), TargetTracker(DirectRefiner(), settings, bodies)
    rows: list[tuple[float, Array, Array, NDArray[np.bool_], str]] = []
    for frame in frames[::every]:
        segmented = segmenter.segment(frame, [tracker.expected])
        (subject,) = segmented.candidates[:1] or segmented.subjects
        updated = tracker.update(tracker.submit(frame, subject, segmented.view.planes, Stopwatch()))
        estimate, sighted = tracker.report(updated).estimate, updated.sighted
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
    reference = read_reference(recording, frames)
    shape = len(frames), len(reference.names)
    joints, holds = np.full((*shape, 3), np.nan), np.zeros(shape, dtype=bool)
    joints[reference.frame], holds[reference.frame] = reference.joints, reference.holds
    return reference.names, joints, holds


def performance_of(recording: Recording) -> str:
    """The action, or who danced, whatever the camera."""
    return recording.name.partition("_")[0]
