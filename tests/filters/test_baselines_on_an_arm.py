"""The baselines through the worker's likelihood, on a few rendered frames of the arm."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.frame import DepthFrame
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import pose_by_name
from coordinator.filters.methods import settings_for
from coordinator.synthesis.scenes import ARM_DOFS, arm
from coordinator.tracking.estimate import MAX_HYPOTHESES
from gepf.direct import DirectRefiner
from tests.support.people import OnePerson, rendered

CAMERA = Intrinsics(256, 256, 395.0, 395.0, 127.5, 127.5)
FRAMES = 6


@cache
def shown() -> list[DepthFrame]:
    """The arm's first frames, at half the size."""
    images = rendered(human(), arm().poses[:FRAMES], CAMERA)
    units = [np.rint(1000.0 * image).astype(np.uint16) for image in images]
    return [DepthFrame(n, n / 25.0, image, 1000.0, CAMERA) for n, image in enumerate(units)]


@pytest.mark.parametrize(("method", "particles"), [("condensation", 150), ("annealed", 20)])
def test_an_arm_is_followed(method: str, particles: int) -> None:
    """From the true start, four angles stay within 8 degrees on average, and few hypotheses are recorded."""
    settings = settings_for(method, "default", particles, 1000)
    start = pose_by_name(human(), arm().poses[0])
    tracker = OnePerson(DirectRefiner(), settings, choose_bodies(ARM_DOFS, "default"), start)
    estimates = [tracker.track(frame) for frame in shown()]
    columns = [human().dof_names.index(name) for name in tracker.model.dof_names]
    poses: NDArray[np.float64] = np.array([estimate.pose for estimate in estimates])
    errors = np.rad2deg(np.abs(poses - arm().poses[:FRAMES, columns]))
    assert errors.mean() < 8.0
    assert all(0 < len(e.hypothesis_weight) <= min(particles, MAX_HYPOTHESES) for e in estimates)
    assert tracker.start.noise.depth < 0.01
