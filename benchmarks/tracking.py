"""One recording tracked in this process, as `gepf track` does it by itself, and held against its joints."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.comparison import Comparison, compare_people, compare_skinned
from benchmarks.sequences import Recording
from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import Bodies
from coordinator.commands.inputs import choose_start
from coordinator.results.summary import count_status
from coordinator.sources import open_source
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation
from coordinator.tracking.search.sizes import GIRTHS
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner
from worker.cli import load_kernel


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """What came of a recording."""

    comparison: Comparison
    seconds: NDArray[np.float64]  # (F,) of processor time that each frame took
    status: dict[str, int]
    hypotheses: float  # mean number
    residual: float  # mean, metres
    stature: float  # metres
    girth: float


def prepare() -> Bodies:
    """Kernels and bodies, ready for all processes that are forked from now on."""
    load_kernel()
    bodies = choose_bodies(None, "default")
    for girth in GIRTHS:
        bodies.full(REFERENCE_STATURE, girth)
    return bodies


def track(
    recording: Recording, settings: Settings, bodies: Bodies, isolation: Isolation | None = None
) -> Tracked:
    """Track all frames and compare; raises whatever goes wrong."""
    source = open_source(recording.depth)
    start = choose_start(None, source)
    tracker = Tracker(DirectRefiner(), settings, bodies, Known(start), isolation)
    estimates, seconds = follow(tracker, source)
    return Tracked(
        comparison=compare(recording, tracker.model.joint_names, estimates),
        seconds=seconds,
        status=count_status(estimates),
        hypotheses=float(np.mean([len(e.hypothesis_weight) for e in estimates])),
        residual=float(np.nanmean([e.residual for e in estimates])),
        stature=tracker.start.stature,
        girth=tracker.start.girth,
    )


def follow(tracker: Tracker, source: Iterable[DepthFrame]) -> tuple[list[Estimate], NDArray[np.float64]]:
    """Estimates of all frames, and the seconds of processor time that each took, its reading aside."""
    estimates, seconds = [], []
    for frame in source:
        began = time.process_time()
        estimates.append(tracker.track(frame))
        seconds.append(time.process_time() - began)
    return estimates, np.array(seconds)


def compare(recording: Recording, names: tuple[str, ...], estimates: Sequence[Estimate]) -> Comparison:
    """Hold the estimated joints against those of the recording."""
    joints = np.array([e.joint_positions for e in estimates])
    frame = np.array([e.frame for e in estimates])
    against = compare_skinned if recording.action is None else compare_people
    return against(recording.joints, names, joints, frame)
