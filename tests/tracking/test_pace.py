"""Time between frames: the filter's interval, and the number of iterations."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.scene.noise import SensorNoise, assume_noise
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.observation import filter_observation
from gepf.coordinator.tracking.particle_filter import FrameBudget, ParticleFilter
from gepf.coordinator.tracking.refiner import with_iterations
from gepf.refiners import DirectRefiner
from tests.support.people import subject_of

CAMERA = Intrinsics(32, 24, 30.0, 30.0, 16.0, 12.0)


@pytest.mark.parametrize(
    ("interval", "factor"), [(1 / 60, 1), (1 / 30, 1), (1 / 15, 3), (0.1, 5), (1 / 6, 9), (2.0, 9)]
)
def test_iterations_go_with_the_time_between_frames(interval: float, factor: int) -> None:
    """The usual number at 30 frames a second or more, at most nine times as many; in `paper` always that."""
    for name, times in (("default", factor), ("paper", 1)):
        usual = preset(name).refine
        paced = filter_of(name).scale_iterations(usual, interval, None)
        assert paced.icp_iterations == times * usual.icp_iterations


def test_particles_are_merged_after_half_of_the_iterations() -> None:
    """Not in `paper`, in a late frame, under heavy noise, or at 30 frames per second."""
    usual, default = preset("default").refine, filter_of("default")
    paced = default.scale_iterations(usual, 0.1, None)
    assert default.early_settings(paced, None) == with_iterations(paced, paced.icp_iterations // 2)
    assert default.early_settings(paced, FrameBudget(0.1, is_late=False)) is not None
    assert default.early_settings(paced, FrameBudget(0.1, is_late=True)) is None
    assert default.early_settings(assume_noise(paced, SensorNoise(0.1, 0.01)), None) is None
    assert default.early_settings(usual, None) is None
    assert filter_of("paper").early_settings(preset("paper").refine, None) is None


def test_a_live_frame_after_a_gap_has_the_filter_of_its_rate() -> None:
    """It has no time for more."""
    usual, budget = preset("default").refine, FrameBudget(1 / 30, is_late=True)
    assert filter_of("default").scale_iterations(usual, 1.0, budget) == usual


def filter_of(name: str) -> ParticleFilter:
    """The filter of a preset."""
    return ParticleFilter(DirectRefiner(), preset(name), PEOPLE, None)


def test_a_sighting_has_the_points_and_the_time_of_its_frame() -> None:
    """Points lie on the surface that is seen; time that stands still or goes back is the usual interval."""
    depth = np.full((24, 32), 2000, dtype=np.uint16)
    subject = subject_of(Frame.of(View(3, 0.5, depth, 1000.0, CAMERA)), 100)
    sighting = filter_observation(subject, 0.4)
    np.testing.assert_allclose(sighting.points[:, 2], 2.0)
    u = CAMERA.cx + CAMERA.fx * sighting.points[:, 0] / 2.0
    np.testing.assert_allclose(u, np.rint(u), atol=1e-9)
    assert sighting.interval == pytest.approx(0.1)
    assert {filter_observation(subject, last).interval for last in (None, 0.5, 0.9)} == {1 / 30}
