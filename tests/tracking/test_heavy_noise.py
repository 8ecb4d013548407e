"""Under heavy noise, each observed point adds information, so more of them are used."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from gepf.common.frame import Frame
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.settings import Settings
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.people import CAMERA, SETTINGS, STANDING, changed, known, shown

FEW = msgspec.structs.replace(SETTINGS, points=500)


def frames(depth_m: float) -> list[Frame]:
    """The frames of a standing person, with this noise in depth."""
    rng, noise = np.random.default_rng(0), SensorNoise(depth_m, min(depth_m, 0.01))
    noisy = []
    for frame in shown("standing").frames:
        (view,) = frame.views
        depth = add_noise(view.metres().astype(np.float64), CAMERA, noise, rng)
        noisy.append(changed(frame, depth=np.rint(1000.0 * depth).astype(np.uint16)))
    return noisy


def points_of(depth_m: float, settings: Settings) -> list[int]:
    """The number of observed points in each frame."""
    tracker = Tracker(DirectRefiner(), settings, known(), start=STANDING)
    subjects = [tracked.people[0].subject for tracked in tracker.follow(frames(depth_m))]
    return [0 if subject is None else len(subject.largest.picked) for subject in subjects]


@pytest.mark.parametrize(("depth_m", "factor"), [(0.005, 3.0), (0.15, 1.0), (0.15, 3.0)])
def test_more_points_are_used_under_heavy_noise(depth_m: float, factor: float) -> None:
    """From the second frame on: the noise is measured in the first one."""
    settings = msgspec.structs.replace(FEW, soft_points_factor=factor)
    first, *others = points_of(depth_m, settings)
    expected = FEW.points * (factor if depth_m > 0.1 else 1.0)
    assert first <= FEW.points
    assert all(0.7 * expected < count <= expected for count in others)
