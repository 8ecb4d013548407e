"""One recording tracked with every n-th of its frames, and held against its reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.frame_rates.reference import Reference, read_reference
from benchmarks.sequences import Recording
from benchmarks.tracking import follow
from benchmarks.utd import JOINTS, distances
from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.results.evaluation import positions
from coordinator.sources import open_source
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """Distances (F, J) in metres from the reference, and where the depth does not contradict it."""

    raw: Array
    offset_removed: Array
    holds: NDArray[np.bool_]
    seconds: float  # of all frames


def track_thinned(recording: Recording, every: int, settings: Settings, bodies: Bodies) -> Compared:
    """Track every n-th frame, beginning with the first."""
    frames = read_frames(recording)
    tracker = Tracker(DirectRefiner(), settings, bodies)
    estimates, seconds = follow(tracker, frames[::every])
    estimated = joints_of(estimates, tracker.model.joint_names)
    numbers = np.array([e.frame for e in estimates])
    return hold_against(read_reference(recording.joints, frames), numbers, estimated, float(seconds.sum()))


def stand_still(recording: Recording, every: int) -> Compared:
    """A tracker that never moves: the reference's first frame for ever."""
    frames = read_frames(recording)
    reference = read_reference(recording.joints, frames)
    numbers = np.arange(0, len(frames), every)
    still = np.broadcast_to(reference.joints[0], (len(numbers), *reference.joints.shape[1:]))
    return hold_against(reference, numbers, still, 0.0)


def read_frames(recording: Recording) -> list[DepthFrame]:
    """All frames, numbered from 0 on."""
    source = open_source(recording.depth)
    return [source.frame(number) for number in source.numbers]


def joints_of(estimates: list[Estimate], names: tuple[str, ...]) -> Array:
    """Estimated joints (F, 13, 3) in the order of the reference."""
    return np.array([e.joint_positions for e in estimates])[:, positions(names, JOINTS)]


def hold_against(
    reference: Reference, numbers: NDArray[np.int64], estimated: Array, seconds: float
) -> Compared:
    """Joints (F, 13, 3) of depth frames (F,) beside those of the reference, by frame number."""
    there, joints, holds = reference.at(numbers)
    return Compared(
        raw=distances(estimated[there], joints, remove_offset=False),
        offset_removed=distances(estimated[there], joints, remove_offset=True),
        holds=holds,
        seconds=seconds,
    )
