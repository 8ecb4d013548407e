"""Places and clocks of cameras from a moving person, with known truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.camera import inverse, moved
from coordinator.calibration.skeletons import Motion, align
from coordinator.calibration.surface import Sight, Surface, place
from tests.support.rigs import around

Array = NDArray[np.float64]

TRUE, OFFSET_S = around(70.0), 0.0123


def joints_at(times: Array) -> Array:
    """Joints (F, 5, 3) that swing about a place, each in its own way."""
    phase = np.arange(15).reshape(5, 3)
    swing = 0.3 * np.sin(times[:, None, None] * (2.0 + 0.3 * phase) + phase)
    return np.array([0.0, 0.0, 2.7]) + 0.3 * np.cos(phase) + swing


def motion(clock_s: float, placed: Array, noise: float = 0.0) -> Motion:
    """These joints for 3 s, as a camera sees them whose clock is so much behind."""
    times = np.arange(90) / 30.0
    seen = moved(joints_at(times + clock_s), inverse(placed))
    seen += np.random.default_rng(0).normal(0.0, 1.0, seen.shape) * noise
    return Motion(times, seen, np.full(seen.shape[:2], 1e-4))


def test_joints_tell_where_a_camera_is_and_its_clock() -> None:
    """Within half a degree, 1 cm and 4 ms, with noise, and a limb that is wrong in a third of the frames."""
    other = motion(OFFSET_S, TRUE, noise=0.01)
    other.joints[:30, 0] += 0.4
    found = align(motion(0.0, np.eye(4)), other)
    assert found is not None
    assert abs(found.offset_s - OFFSET_S) < 0.004
    turn = found.placed[:3, :3] @ TRUE[:3, :3].T
    assert np.degrees(np.arccos(min(1.0, (np.trace(turn) - 1.0) / 2.0))) < 0.5
    person = moved(np.array([0.0, 0.0, 2.7]), inverse(TRUE))
    assert np.linalg.norm(moved(person, found.placed) - [0.0, 0.0, 2.7]) < 0.01


def test_recordings_of_different_times_are_not_aligned() -> None:
    """If what is known of one joint set never meets the other, there is no alignment."""
    known, other = motion(0.0, np.eye(4)), motion(0.0, TRUE)
    other.variance[:] = np.inf
    assert align(known, other) is None


def test_points_of_a_moving_surface_place_a_camera() -> None:
    """A camera that is 1.5 degrees, 3 cm and 8 ms off is put right to 0.02 degrees, 0.5 mm and 0.5 ms."""
    rng, sights = np.random.default_rng(1), []
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shape = normals * [0.3, 0.8, 0.2]  # an ellipsoid, whose normals follow from its axes
    normals = shape / np.array([0.3, 0.8, 0.2]) ** 2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    camera = TRUE[:3, 3]
    for n in range(30):
        middle = np.array([0.4 * np.sin(n), 0.1 * np.cos(2.0 * n), 2.7])
        velocity = np.array([np.cos(n), 0.3, np.sin(2.0 * n)])
        surface = Surface(n / 3.0, shape + middle, normals, np.tile(velocity, (3000, 1)))
        late = surface.vertices + OFFSET_S * velocity
        seen = np.flatnonzero(np.sum(normals * (camera - late), axis=1) > 0.0)[::5]
        points = moved(late[seen], inverse(TRUE))
        sights.append(Sight(surface.time_s + OFFSET_S - 0.008, points, surface))
    off = around(71.5)
    off[:3, 3] += [0.02, -0.01, 0.02]
    found = place(sights, off)
    assert found is not None
    placed = found.apply(off)
    assert abs(found.step[6] - 0.008) < 0.0005
    assert np.degrees(np.abs(placed[:3, :3] @ TRUE[:3, :3].T - np.eye(3)).max()) < 0.02
    person = moved(np.array([0.0, 0.0, 2.7]), inverse(TRUE))
    assert np.linalg.norm(moved(person, placed) - [0.0, 0.0, 2.7]) < 0.0005
