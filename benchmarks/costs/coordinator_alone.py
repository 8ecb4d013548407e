"""What the coordinator does by itself each frame: cut out, draw, merge, report, record."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.costs.standing import CAMERA, POSE, standing
from common.frame import DepthFrame, SubjectFrame
from common.protocol.frames import encode_frame
from common.refinement import Refined
from common.settings import preset
from coordinator.bodies.choice import choose_bodies
from coordinator.pool.options import PoolStatistics
from coordinator.results.recorder import Recorder
from coordinator.tracking.known import Known
from coordinator.tracking.observing.sensor_noise import SensorNoise
from coordinator.tracking.single import SingleTracker as Tracker
from tests.support.asked import Asked
from tests.support.refined import sure
from tests.support.stand_ins import Ready, StandIn

SCATTER = 0.03  # radians and metres by which the pretended descent ends apart, so that there is work to merge


class InstantRefiner(StandIn):
    """Takes no time: poses about the first one, the likelier the nearer."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)
        self._valley: NDArray[np.float64] | None = None  # (1, D)

    def publish(self, subject: SubjectFrame) -> None:
        """Encode the frame, as publishing it does."""
        encode_frame(subject)

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Encode it, too."""
        encode_frame(subject)

    def answer(self, asked: Asked) -> Ready:
        """Poses (N, D), scattered."""
        poses = asked.poses
        self._valley = poses[:1] if self._valley is None else self._valley
        apart = self._rng.normal(scale=SCATTER, size=poses.shape)
        likelihood = -np.square(apart).sum(axis=1)
        roots = sure(poses, SCATTER) if asked.covariance else None
        return Ready(Refined(self._valley + apart, likelihood, np.full(len(poses), 0.01), roots))


def coordinator_stages(rounds: int) -> dict[str, Any]:
    """Medians of milliseconds by stage over so many frames, preset `default`."""
    case = standing(10_000, SensorNoise(), 0)
    frame = whole_image(case.subject)
    tracker = Tracker(InstantRefiner(), preset("default"), choose_bodies(None, "default"), Known(POSE))
    laps: list[dict[str, float]] = []
    with (
        tempfile.TemporaryDirectory(prefix="gepf-") as folder,
        Recorder(Path(folder) / "run", {}) as recorder,
    ):
        for _ in range(3 + rounds):
            began = time.perf_counter()
            estimate = tracker.track(frame)
            tracked = time.perf_counter()
            recorder.append(estimate, tracker.state, PoolStatistics(), 0.0)
            recorded = time.perf_counter()
            laps.append(estimate.stage_seconds | {"record": recorded - tracked, "all": recorded - began})
    stages = [name for name in laps[-1] if name != "refine"]
    return {stage: 1e3 * float(np.median([lap[stage] for lap in laps[3:]])) for stage in stages}


def whole_image(subject: SubjectFrame) -> DepthFrame:
    """The camera's image with the subject where it was."""
    left, top, _, _ = subject.view
    depth = np.zeros((CAMERA.height, CAMERA.width), np.uint16)
    rows, columns = subject.frame.depth.shape
    depth[-top : rows - top, -left : columns - left] = subject.frame.depth
    return DepthFrame(0, 0.0, depth, subject.frame.depth_scale, CAMERA)
