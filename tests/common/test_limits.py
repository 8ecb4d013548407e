"""Poses within the limits of their joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.kinematics import natural_angles, pose_vertices, within_limits
from tests.support.bodies import puppet
from tests.support.kernel import plain_path

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_natural_angles_are_the_same_rotations_nearer_to_the_limits(seed: int) -> None:
    """Angles on the other branch, or turned around, come back into limits; the surface stays where it was."""
    rng = np.random.default_rng(seed)
    model = replace(puppet(), limits=np.tile([-1.5, 1.5], (19, 1)))
    poses = rng.uniform(-1.4, 1.4, size=(4, 19))
    flipped = poses.copy()
    for start in model.balls:
        flipped[:2, start : start + 3] = poses[:2, start : start + 3] * [1.0, -1.0, 1.0] + np.pi
        flipped[2, start : start + 3] += 2.0 * np.pi * rng.integers(-1, 2, size=3)
    found = natural_angles(model, flipped)
    np.testing.assert_allclose(found, poses, atol=1e-9)
    np.testing.assert_allclose(pose_vertices(model, found), pose_vertices(model, flipped), atol=1e-9)


def test_where_both_are_within_limits_angles_stay() -> None:
    """Without limits every branch is as good, and a body may turn around as often as it likes."""
    model = replace(puppet(), limits=np.tile([-np.inf, np.inf], (19, 1)))
    poses = np.random.default_rng(0).uniform(-9.0, 9.0, size=(5, 19))
    np.testing.assert_array_equal(natural_angles(model, poses), poses)


@given(seeds)
def test_single_axes_are_clamped_and_balls_are_let_be(seed: int) -> None:
    """The poses that the plain path gives; those that were given stay as they are."""
    model = replace(puppet(), limits=np.tile([-0.5, 0.3], (19, 1)))
    poses = np.random.default_rng(seed).uniform(-1.4, 1.4, size=(4, 19))
    before = poses.copy()
    found = within_limits(model, poses)
    np.testing.assert_array_equal(found, [plain_path.clamp_to_limits(model, pose) for pose in poses])
    np.testing.assert_array_equal(poses, before)
    assert np.any(found[:, model.single] != poses[:, model.single])
