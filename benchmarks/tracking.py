"""One recording tracked in this process as by `gepf track`, with its reference."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.recordings import UPPER_JOINTS, Recording, cut_frames, read_frames, read_reference
from gepf.common.arrays import Array, Mask
from gepf.common.frame import Frame
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.results.evaluation import THRESHOLDS, positions
from gepf.coordinator.results.tally import count_status
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.source import rate_of
from gepf.coordinator.tracking.reporting import TrackedPerson
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from gepf.worker.cli import load_kernel


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The result of a recording, for the F frames that have a reference."""

    recording: Recording
    joints: Array  # (F, J, 3) metres, camera frame
    reference: Array  # (F, J, 3)
    holds: Mask  # (F, J) joints whose reference agrees with depth
    seconds: Array  # processor time of each tracked frame
    fps: float  # tracked frames per second of the recording
    status: dict[str, int]  # number of frames by the tracker's status
    stature: float  # metres, after the last frame

    def distances(self, *, raw: bool) -> Array:
        """Distances (F, J) from the reference, metres; without each joint's median offset if not `raw`."""
        apart = self.joints - self.reference
        if not raw:
            apart = apart - np.nanmedian(apart, axis=0)
        found: Array = np.linalg.norm(apart, axis=-1)
        return found


@cache
def bodies_of(preset: str) -> Bodies:
    """The bodies for a preset."""
    return choose_bodies(None, preset)


def prepare() -> Bodies:
    """Load kernels and bodies before processes are forked."""
    load_kernel(1)
    return bodies_of("default")


def track(
    recording: Recording,
    settings: Settings | None,
    every: int = 1,
    frames: int | None = None,
    cut: str | None = None,
) -> Outcome:
    """Track every n-th frame, at most `frames`; without settings, keep the first reference pose.

    Of images that are `cut` below a joint, only the upper joints count.
    """
    read = read_frames(recording)
    reference = read_reference(recording, read)
    if cut is not None:
        read = cut_frames(read, reference, cut)
        reference = reference.take(UPPER_JOINTS)
    thinned = read[::every][:frames]
    numbers = [frame.number for frame in thinned]
    _, mine, theirs = np.intersect1d(numbers, reference.frame, return_indices=True)
    status, seconds, stature = dict[str, int](), np.zeros(len(thinned)), float("nan")
    if settings is None:
        joints = np.broadcast_to(reference.joints[0], (len(mine), *reference.joints.shape[1:]))
    else:
        found, seconds = follow(Tracker(DirectRefiner(), settings, bodies_of(settings.preset)), thinned)
        start = found[-1].state.start
        columns = positions(start.model.joint_names, reference.names)
        joints = np.array([found[row].estimate.joint_positions[columns] for row in mine])
        status, stature = count_status(one.estimate.status for one in found), found[-1].state.size[0]
    return Outcome(
        recording,
        joints,
        reference.joints[theirs],
        reference.holds[theirs],
        seconds,
        rate_of([frame.time_s for frame in thinned]),
        status,
        stature,
    )


def follow(tracker: Tracker, frames: Iterable[Frame]) -> tuple[list[TrackedPerson], Array]:
    """Estimates, and processor time (F,) in seconds of each frame, without reading it."""
    found, seconds = [], []
    for frame in frames:
        began = time.process_time()
        found.append(tracker.track(frame).people[0])
        seconds.append(time.process_time() - began)
    return found, np.array(seconds)


def near_percent(distances: Array) -> float:
    """Percentage of distances (metres, any shape) within 10 cm."""
    return 100.0 * float(np.mean(distances <= THRESHOLDS.near_m)) if distances.size else float("nan")
