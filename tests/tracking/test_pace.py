"""Time between frames: the filter's interval, and the number of iterations."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.observation import filter_observation
from gepf.coordinator.tracking.particle_filter import pace_iterations
from tests.support.people import subject_of

CAMERA = Intrinsics(32, 24, 30.0, 30.0, 16.0, 12.0)


@pytest.mark.parametrize(
    ("interval", "factor"), [(1 / 60, 1), (1 / 30, 1), (1 / 15, 3), (0.1, 5), (1 / 6, 9), (2.0, 9)]
)
def test_iterations_go_with_the_time_between_frames(interval: float, factor: int) -> None:
    """The usual number at 30 frames a second or more, at most nine times as many; in `paper` always that."""
    for each, times in ((preset("default"), factor), (preset("paper"), 1)):
        paced = pace_iterations(each.refine, interval, each)
        assert paced.icp_iterations == times * each.refine.icp_iterations


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
