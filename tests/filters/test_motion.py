"""Motion between frames: prediction by velocity, and the motion prior of unobserved limbs."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.kinematics import difference
from gepf.common.refinement import Refined, lower_triangular
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.filters.gradient_enhanced import begin, propose
from gepf.coordinator.filters.priors import fuse_with_prediction, motion_model
from gepf.coordinator.settings import preset
from tests.support.bodies import puppet
from tests.support.filtering import INTERVAL, NOTHING_SEEN, Merging, update_once, update_twice

MODEL = puppet()
WEAK = np.radians(30.0), 0.05  # deviations of what nothing is known about
DOFS = len(MODEL.dof_names)
KEEPS_ALL = msgspec.structs.replace(preset("default").filter, min_early_weight=0.0)
merged = pytest.mark.parametrize("merging", [update_once, update_twice])
BASE = np.isin(MODEL.dof_names, ROOT_DOFS)


def deviations(model: BodyModel, turn: float, slide: float) -> Array:
    """Of each degree of freedom (D,)."""
    return np.where(model.kinds == ROTATION, turn, slide)


def some_poses(rng: np.random.Generator) -> tuple[Array, Array]:
    """A pose (1, D) well within its limits, and another one near it."""
    low, high = np.clip(MODEL.limits, -0.5, 0.5).T
    pose = 0.5 * (low + high)[None]
    return pose, pose + 0.05 * rng.standard_normal(pose.shape)


@pytest.mark.parametrize("frames", [1, 2, 3, 5, 10])
def test_a_swing_is_not_overshot_however_it_is_sampled(frames: int) -> None:
    """An arm that swings at 1.3 Hz and 60 degrees, seen every n-th of 30 frames a second.

    The prediction error is hardly larger than without motion, at most 10 degrees beyond the swing's end.
    """
    interval = frames / 30.0
    times = np.arange(0.0, 20.0, interval)
    angle = np.radians(60.0) * np.sin(2.0 * np.pi * 1.3 * times)[:, None]
    model = motion_model(preset("default").filter)
    velocity = model.update(np.diff(angle, axis=0)[:-1], interval)
    past = replace(Belief.at(np.zeros(1)), velocities=velocity)
    predicted = angle[1:-1] + model.predict(past, interval)
    held, off = np.abs(angle[2:] - angle[1:-1]), np.abs(angle[2:] - predicted)
    assert off.mean() <= 1.05 * held.mean()
    assert np.degrees(np.abs(predicted).max()) < 70.0


@pytest.mark.parametrize("interval", [1 / 60, 1 / 30, 0.1, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_held_pose_is_the_likeliest_given_frame_and_motion(seed: int, interval: float) -> None:
    """In finite differences, the log posterior of both is level there; of the base nothing is expected."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((DOFS, DOFS))
    shows = root.T @ root * 10.0 ** rng.uniform(-1, 3)
    weak = deviations(MODEL, *WEAK) ** -2.0
    motion = deviations(MODEL, np.radians(15.0), 0.05) ** -2.0 / 30.0 / interval
    refined, expected = some_poses(rng)
    way = difference(MODEL, refined, expected)[0]

    def cost(step: Array) -> float:
        off = np.where(BASE, 0.0, step - way)
        of_base = np.where(BASE, step, 0.0)
        return float(0.5 * (step @ shows @ step + off @ (motion * off) + of_base @ (weak * of_base)))

    found = np.linalg.inv(shows + np.diag(weak))[None]
    step = difference(MODEL, refined, fuse_with_prediction(MODEL, refined, found, expected, interval, 15.0))[
        0
    ]
    small = 1e-4
    slope = [(cost(step + small * e) - cost(step - small * e)) / (2 * small) for e in np.eye(DOFS)]
    np.testing.assert_allclose(slope, 0.0, atol=1e-3 * np.abs(motion * way).max())


def test_nothing_is_held_beyond_its_limits() -> None:
    """An elbow predicted beyond its limit is straight."""
    refined, _ = some_poses(np.random.default_rng(0))
    bounded = MODEL.single & ~BASE & np.isfinite(MODEL.limits).all(axis=1)
    assert bounded.any()
    expected = np.where(bounded, MODEL.limits[:, 1] + 0.3, refined)
    found = np.diag(deviations(MODEL, *WEAK) ** 2)[None]
    held = fuse_with_prediction(MODEL, refined, found, expected, 1.0 / 30.0, 15.0)
    np.testing.assert_array_equal(held[0, bounded], MODEL.limits[bounded, 1])


@merged
def test_each_particle_is_held_about_its_own_way_on(merging: Merging) -> None:
    """In the order of the hypotheses, by likelihood."""
    rng, settings = np.random.default_rng(0), KEEPS_ALL
    drawn = propose(MODEL, begin(MODEL, np.zeros(DOFS), settings), NOTHING_SEEN, settings, rng)
    expected, poses = 0.1 * rng.standard_normal((2, *drawn.poses.shape))
    proposal = replace(drawn, expected=expected)
    likelihood = np.arange(len(poses), dtype=np.float64)
    root = np.diag(deviations(MODEL, 0.01, 0.001))[np.tri(DOFS, dtype=bool)].astype(np.float32)
    roots = np.tile(root, (len(poses), 1))
    after = Refined(poses, likelihood, np.full(len(poses), 0.01), roots)
    found = merging(MODEL, proposal, after, settings, rng)
    order = np.arange(len(poses))[::-1]
    covariances = lower_triangular(roots, DOFS) ** 2  # diagonal
    held = fuse_with_prediction(MODEL, poses[order], covariances, expected[order], INTERVAL, 15.0)
    np.testing.assert_allclose(found.poses, held, atol=1e-12)
    np.testing.assert_allclose(found.velocities, difference(MODEL, np.zeros_like(held), held) / INTERVAL)


@merged
def test_the_prior_of_a_hypothesis_is_that_of_the_pose_it_is_held_in(merging: Merging) -> None:
    """Where motion moves a hidden limb after its refinement, weights follow, and so does the order."""
    rng, settings = np.random.default_rng(0), KEEPS_ALL
    drawn = propose(MODEL, begin(MODEL, np.zeros(DOFS), settings), NOTHING_SEEN, settings, rng)
    poses, likelihood = 0.1 * rng.standard_normal(drawn.poses.shape), rng.standard_normal(len(drawn.poses))
    expected = poses + 0.3 * rng.standard_normal(poses.shape)

    def log_prior(poses: Array) -> Array:
        return np.asarray(-20.0 * np.sum(poses[:, ~BASE] ** 2, axis=1))

    proposal = replace(drawn, expected=expected, log_prior=log_prior)
    root = np.diag(deviations(MODEL, 0.3, 0.01))[np.tri(DOFS, dtype=bool)].astype(np.float32)
    roots = np.tile(root, (len(poses), 1))
    after = Refined(poses, likelihood + log_prior(poses), likelihood, roots)
    found = merging(MODEL, proposal, after, msgspec.structs.replace(settings, merge_variances=1e-9), rng)
    assert len(found.poses) == len(poses)
    np.testing.assert_allclose(found.log_weights, found.residual + log_prior(found.poses), atol=1e-9)
    assert np.all(np.diff(found.log_weights) <= 0.0)
    refined = dict(zip(likelihood, log_prior(poses), strict=True))
    assert np.any(np.diff([likely + refined[likely] for likely in found.residual]) > 0.0)  # another order
