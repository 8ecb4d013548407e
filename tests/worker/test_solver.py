"""A rendered body recovers a perturbed pose: the descent as a whole, on a person of 24 degrees of freedom."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import ROTATION
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.settings import preset
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import Observation, observe
from tests.support.bodies import person
from tests.support.people import frame_of, rendered, subject_of

POINTS = 3000
PERTURBATIONS = 6
OFF_ROTATION, OFF_POSITION = np.radians(6.0), 0.04  # standard deviations of where the descent starts
ARMS_APART = {"root_tz": 2.6, "r_shoulder_abduct": 0.7, "l_shoulder_abduct": 0.6}
POSES: dict[str, Mapping[str, float]] = {
    "arms apart": ARMS_APART,
    "turned, elbows bent": {**ARMS_APART, "root_ry": 0.5, "r_elbow_flexion": 1.2, "l_elbow_flexion": 0.8},
    "a step": {**ARMS_APART, "l_hip_flexion": 0.6, "l_knee_flexion": 0.8, "r_hip_abduct": 0.2},
}


@cache
def seen(name: str) -> tuple[Array, Observation]:
    """A pose (D,) of the person, and its observation."""
    truth = name_pose(person(), POSES[name])
    (depth,) = rendered(person(), truth[None])
    return truth, observe(subject_of(frame_of(0, depth), POINTS))


def perturbed(truth: Array) -> Array:
    """Poses (PERTURBATIONS, D) about the truth."""
    spread = np.where(person().kinds == ROTATION, OFF_ROTATION, OFF_POSITION)
    rng = np.random.default_rng(0)
    return np.asarray(truth + spread * rng.standard_normal((PERTURBATIONS, len(truth))))


def joint_errors(poses: Array, truth: Array) -> Array:
    """Distance (N, J) of every joint from the truth, metres."""
    joints = joint_positions(person(), np.concatenate([truth[None], poses]))
    return np.asarray(np.linalg.norm(joints[1:] - joints[:1], axis=-1))


@pytest.mark.parametrize("name", POSES)
@pytest.mark.parametrize("settings", ["paper", "default"])
def test_a_perturbed_pose_is_recovered(settings: str, name: str) -> None:
    """From poses with joints 9 cm off on average, given time, nearly all come to within 2 cm of the truth."""
    truth, observation = seen(name)
    start = perturbed(truth)
    thorough = msgspec.structs.replace(preset(settings).refine, icp_iterations=40)
    particles = Particles(start, thorough, prior=pose_prior(person(), thorough))
    before, after = (
        joint_errors(poses, truth) for poses in (start, refine(person(), observation, particles).poses)
    )
    assert before.mean() > 0.08
    assert np.mean(before < 0.02) < 0.1
    assert np.mean(after < 0.02) > 0.95
    assert after.mean() < 0.01


@pytest.mark.parametrize("name", POSES)
def test_the_truth_stays_and_is_the_likeliest(name: str) -> None:
    """The descent leaves the true pose within 5 mm, and finds nothing near it likelier.

    This is without the pose prior, which adds at most a millimetre.
    """
    truth, observation = seen(name)
    start, default = np.concatenate([truth[None], perturbed(truth)]), preset("default").refine
    for deviation, farthest in ((0.0, 0.005), (default.pose_deviation, 0.006)):
        settings = msgspec.structs.replace(default, pose_deviation=deviation)
        prior = pose_prior(person(), settings)
        refined = refine(person(), observation, Particles(start, settings, prior=prior))
        assert joint_errors(refined.poses[:1], truth).max() < farthest
        assert np.argmax(refined.log_likelihood) == 0
