"""Places and clocks of cameras from a moving person, with known truth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from common.camera import inverse, moved
from common.errors import InputError
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.dofs import HUMAN
from coordinator.calibration.rig import CameraPlace, judge
from coordinator.calibration.skeletons import Motion, align
from coordinator.calibration.surface import Placement, Sight, Surface, place
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


def ellipsoid() -> tuple[Array, Array]:
    """Vertices (V, 3) and their normals, which follow from the axes."""
    axes = np.array([0.3, 0.8, 0.2])
    shape = np.random.default_rng(1).normal(size=(3000, 3))
    shape *= axes / np.linalg.norm(shape, axis=1, keepdims=True)
    normals = shape / axes**2
    return shape, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def seen_by(cameras: list[Array], clocks_s: list[float], outside: Array, shaken: Array) -> list[Sight]:
    """What cameras see of an ellipsoid that moves for 15 s, in steps of half a second.

    outside: (C, 16) distance of the true surface from the model's at each link, on the side of each camera.
    shaken: (30, 3) error of its place in each step.
    """
    sights, (shape, normals) = list[Sight](), ellipsoid()
    links = (shape[:, 1] * 5.0 + 4.0).astype(np.int64) * 2 + (shape[:, 0] > 0.0)
    for n in range(30):
        middle = np.array([0.4 * np.sin(n), 0.1 * np.cos(2.0 * n), 2.7])
        velocity = np.array([np.cos(n), 0.3, np.sin(2.0 * n)])
        surface = Surface(n / 2.0, shape + middle, normals, np.tile(velocity, (len(shape), 1)), links)
        for c, (placed, clock) in enumerate(zip(cameras, clocks_s, strict=True)):
            true = surface.vertices + outside[c][links][:, None] * normals + shaken[n] + OFFSET_S * velocity
            seen = np.flatnonzero(np.sum(normals * (placed[:3, 3] - true), axis=1) > 0.0)[c::7]
            sights.append(Sight(c, OFFSET_S + clock, moved(true[seen], inverse(placed)), surface))
    return sights


def errors_of(found: Placement | None, cameras: list[Array], clocks_s: list[float]) -> Array:
    """Errors (7,) of the second camera: rotation, position at the person, clock."""
    assert found is not None
    turn = found.placed[1][:3, :3] @ cameras[1][:3, :3].T
    person = moved(np.array([0.0, 0.0, 2.7]), inverse(cameras[1]))
    apart = moved(person, found.placed[1]) - [0.0, 0.0, 2.7]
    clock = found.steps[1, 6] + clocks_s[1] - clocks_s[0]
    return np.array([turn[2, 1], turn[0, 2], turn[1, 0], *apart, clock])


def test_points_of_a_moving_surface_place_a_camera() -> None:
    """1.5 degrees, 3 cm and 8 ms are put right to 0.02 degrees, 0.5 mm and 0.5 ms, of a person too thick."""
    clocks, outside = [0.0, -0.008], np.full((2, 16), 0.006)
    sights = seen_by([np.eye(4), TRUE], clocks, outside, np.zeros((30, 3)))
    off = around(71.5)
    off[:3, 3] += [0.02, -0.01, 0.02]
    errors = errors_of(place(sights, np.array([np.eye(4), off])), [np.eye(4), TRUE], clocks)
    assert np.degrees(np.abs(errors[:3]).max()) < 0.02
    assert np.abs(errors[3:6]).max() < 0.0005
    assert abs(errors[6]) < 0.0005


def test_stated_deviations_are_those_of_the_errors() -> None:
    """With random errors of shape and pose, 60 to 92 % are within one deviation, 90 to 100 % within two."""
    rng, shares = np.random.default_rng(2), []
    places, clocks = [np.eye(4), TRUE], [0.0, 0.0]
    for _ in range(12):
        outside = rng.normal(0.0, 0.004, 16) + rng.normal(0.0, 0.005, (2, 1))
        found = place(seen_by(places, clocks, outside, rng.normal(0.0, 0.004, (30, 3))), np.array(places))
        assert found is not None
        shares.append(np.abs(errors_of(found, places, clocks)) / found.deviations[1])
    assert 0.60 < np.mean(np.array(shares) < 1.0) < 0.92
    assert np.mean(np.array(shares) < 2.0) > 0.90


def test_the_first_round_measures_the_thickness() -> None:
    """Of a person who is 6 mm outside of the model; once it is known, the surfaces stay where they are."""
    sights = seen_by([np.eye(4), TRUE], [0.0, 0.0], np.full((2, 16), 0.006), np.zeros((30, 3)))
    places = np.array([np.eye(4), TRUE])
    found, known = place(sights, places), place(sights, places, shape_known=True)
    assert found is not None
    assert known is not None
    assert found.outside == pytest.approx(0.006, abs=0.0005)
    assert known.outside == 0.0


def test_a_thicker_body_is_farther_out_everywhere() -> None:
    """By 6 mm along its normals, with the same joints."""
    bodies = choose_bodies(None, "default", HUMAN)
    slim, thick = bodies.full(1.7, 1.0), bodies.thicker(0.006).full(1.7, 1.0)
    moves = thick.vertices - slim.vertices
    assert np.allclose(np.linalg.norm(moves, axis=1), 0.006, atol=1e-6)
    assert np.ptp(thick.vertices, axis=0) == pytest.approx(np.ptp(slim.vertices, axis=0) + 0.009, abs=0.004)
    assert np.array_equal(thick.joint_points, slim.joint_points)


def test_what_is_not_determined_is_refused_with_what_would_help() -> None:
    """A deviation of 3 degrees, 10 cm or 0.1 s; it is said which one, of which camera."""
    for place_of, what in ((0, "rotation"), (4, "position"), (6, "clock")):
        deviations = np.full(7, 1e-4)
        assert judge("side", CameraPlace(TRUE, 0.0, deviations)).advice
        deviations[place_of] = 0.1
        with pytest.raises(InputError, match=f"the {what} of side is not determined; w"):
            judge("side", CameraPlace(TRUE, 0.0, deviations))


def test_a_camera_that_sees_nothing_is_not_placed() -> None:
    """Without points of each camera there is no placement."""
    alone = seen_by([np.eye(4)], [0.0], np.zeros((1, 16)), np.zeros((30, 3)))
    assert place(alone, np.array([np.eye(4), TRUE])) is None
