"""Poses and clocks of cameras from a moving person, with known truth."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.camera import inverse, moved
from gepf.common.errors import InputError
from gepf.coordinator.calibration.rig import CameraPose, Motion, advised, align
from tests.support.rigs import around

TRUE, OFFSET_S = around(70.0), 0.0123


def joints_at(times: Array) -> Array:
    """Joints (F, 5, 3) that swing about a place, each in its own way."""
    phase = np.arange(15).reshape(5, 3)
    swing = 0.3 * np.sin(times[:, None, None] * (2.0 + 0.3 * phase) + phase)
    return np.array([0.0, 0.0, 2.7]) + 0.3 * np.cos(phase) + swing


def motion(clock_s: float, placed: Array, noise: float = 0.0) -> Motion:
    """These joints for 3 s by too thin a body, as a camera sees them whose clock is so much behind."""
    times = np.arange(90) / 30.0
    seen = moved(joints_at(times + clock_s), inverse(placed))
    by_girth = np.linspace(0.0, 0.15, 5)[:, None] * seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    seen += np.random.default_rng(0).normal(0.0, 1.0, seen.shape) * noise - 0.2 * by_girth
    return Motion(times, seen, np.full(seen.shape[:2], 1e-4), by_girth)


def test_joints_tell_where_a_camera_is_and_its_clock() -> None:
    """Within half a degree, 1 cm, 4 ms: with noise, a wrong girth, a limb wrong in a third of the frames."""
    other = motion(OFFSET_S, TRUE, noise=0.01)
    other.joints[:30, 0] += 0.4
    found = align(motion(0.0, np.eye(4)), other)
    assert found is not None
    assert abs(found.offset_s - OFFSET_S) < 0.004
    turn = found.T_first_other[:3, :3] @ TRUE[:3, :3].T
    assert np.degrees(np.arccos(min(1.0, (np.trace(turn) - 1.0) / 2.0))) < 0.5
    person = moved(np.array([0.0, 0.0, 2.7]), inverse(TRUE))
    assert np.linalg.norm(moved(person, found.T_first_other) - [0.0, 0.0, 2.7]) < 0.01


def test_recordings_of_different_times_are_not_aligned() -> None:
    """If what is known of one joint set never meets the other, there is no alignment."""
    known, other = motion(0.0, np.eye(4)), motion(0.0, TRUE)
    other.variance[:] = np.inf
    assert align(known, other) is None


def test_stated_deviations_are_those_of_the_errors() -> None:
    """Of joints that cameras see 2 cm apart: 55 to 90 % are within one deviation, most within two."""
    rng, shares = np.random.default_rng(2), []
    for _ in range(12):
        other = motion(OFFSET_S, TRUE, noise=0.005)
        other.joints[:] += rng.normal(0.0, 0.02, (1, 5, 3))
        found = align(motion(0.0, np.eye(4)), other)
        assert found is not None
        shares.append(np.abs(errors_of(found)) / found.deviations)
    assert 0.55 < np.mean(np.array(shares)[:, :6] < 1.0) < 0.9
    assert np.mean(np.array(shares)[:, :6] < 2.0) > 0.85


def test_of_opposite_cameras_the_distance_is_the_least_certain() -> None:
    """A body that is too thin moves both towards each other, one that is too thick apart."""
    found = align(motion(0.0, np.eye(4)), motion(0.0, around(180.0)))
    assert found is not None
    assert found.deviations[5] > 4.0 * found.deviations[3:5].max()


def errors_of(found: CameraPose) -> Array:
    """Errors (7,) of the alignment: rotation, position at the person, clock."""
    turn = found.T_first_other[:3, :3] @ TRUE[:3, :3].T
    person = joints_at(np.arange(90) / 30.0).mean(axis=(0, 1))
    apart = moved(moved(person, inverse(TRUE)), found.T_first_other) - person
    return np.array([turn[2, 1], turn[0, 2], turn[1, 0], *apart, found.offset_s - OFFSET_S])


def test_what_is_not_determined_is_refused_with_what_would_help() -> None:
    """A deviation of 3 degrees, 10 cm or 0.1 s; it is said which one, of which camera."""
    for place_of, what in ((0, "rotation"), (4, "position"), (6, "clock")):
        deviations = np.full(7, 1e-4)
        assert advised("side", CameraPose(TRUE, 0.0, 0.0, deviations)).advice
        deviations[place_of] = 0.1
        with pytest.raises(InputError, match=f"the {what} of side is not determined; w"):
            advised("side", CameraPose(TRUE, 0.0, 0.0, deviations))
