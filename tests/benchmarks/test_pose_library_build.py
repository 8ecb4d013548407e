"""How poses of the library are made: conversion of recorded joints, mirror images, choice of medoids."""

from __future__ import annotations

import numpy as np

from benchmarks.pose_library import choose_medoids, combine, fit, mirrored
from gepf.common.arrays import Array
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.shape_space import Size

MODEL = choose_bodies(None, "default").for_start(*Size(1.75, 1.0))


def some_poses(count: int) -> Array:
    """Poses (N, D) of people who stand, sit and kneel, seen from all sides."""
    return combine(MODEL, np.zeros((1, len(MODEL.dof_names))), count, np.random.default_rng(7))


def test_recorded_joints_become_poses() -> None:
    """Joints of known poses are met by almost all fits, within the limits."""
    joints = joint_positions(MODEL, some_poses(40))
    poses, error = fit(MODEL, joints)
    low, high = MODEL.limits.T
    assert np.all((poses >= low) & (poses <= high))
    off = np.linalg.norm(joint_positions(MODEL, poses) - joints, axis=-1).mean(axis=-1)
    np.testing.assert_allclose(error, off)
    assert np.mean(error < 0.02) > 0.9


def test_a_mirror_image_has_the_joints_of_the_other_side() -> None:
    """Mirrored across the middle, left and right exchanged."""
    poses = some_poses(20)
    exchanged = {"left": "right", "right": "left"}
    names = ["_".join(exchanged.get(part, part) for part in name.split("_")) for name in MODEL.joint_names]
    expected = joint_positions(MODEL, poses)[:, [MODEL.joint_names.index(name) for name in names]]
    np.testing.assert_allclose(
        joint_positions(MODEL, mirrored(MODEL, poses)), expected * np.array([-1.0, 1.0, 1.0]), atol=1e-9
    )


def test_medoids_are_those_of_the_plain_greedy_choice() -> None:
    """Each next one is the pose that most reduces the sum of the distances to the nearest chosen one."""
    places = np.random.default_rng(2).normal(size=(60, 3))
    apart = np.linalg.norm(places[:, None] - places, axis=-1).astype(np.float32)
    chosen: list[int] = []
    for _ in range(12):
        sums = [np.min(apart[[*chosen, n]], axis=0).astype(np.float64).sum() for n in range(len(places))]
        chosen.append(int(np.argmin(sums)))
    assert choose_medoids(apart, 12).tolist() == chosen
