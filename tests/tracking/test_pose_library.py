"""The library of poses: its descriptors, and which of its poses look like what is observed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.common.kinematics.rotations import euler_matrix
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.human.typical_poses import people_poses
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.settings import SearchSettings
from gepf.coordinator.tracking.descriptor import COLUMNS, ROWS, VACANT, describe, fill_differences
from gepf.coordinator.tracking.pose_library import at_quarter_turns, describe_poses, rotation_to_optical_axis
from tests.support.people import SITTING, STANDING

MODEL = human(1.75)
CELL = 0.06  # metres


def described(points: Array) -> tuple[NDArray[np.float32], Array, int]:
    """The image, the middle and the number of cells of points."""
    image, middle = np.empty((ROWS, COLUMNS), dtype=np.float32), np.empty(3)
    return image, middle, describe(points, CELL, image, middle)


def test_a_descriptor_is_the_same_wherever_the_body_is() -> None:
    """Moved by whole cells and any depth, a cloud has the same image; its middle moves along."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (400, 3))
    image, middle, cells = described(points)
    moved, other, count = described(points + np.array([3 * CELL, -2 * CELL, 2.5]))
    assert cells == count == np.count_nonzero(image < VACANT)
    np.testing.assert_allclose(other - middle, [3 * CELL, -2 * CELL, 2.5], atol=1e-9)
    same = np.isclose(image, moved, atol=1e-5)
    assert same.mean() > 0.99  # a point on a cell's edge may change sides by rounding


def test_descriptors_are_compared_as_the_definition_says() -> None:
    """The sum over cells of min(|dz|, bound)^2; a cell that only one of two fills counts the bound."""
    rng, bound = np.random.default_rng(1), 0.25
    images = rng.normal(0.0, 0.2, (5, ROWS, COLUMNS)).astype(np.float32)
    images[rng.random(images.shape) < 0.7] = VACANT
    seen, out = images[0], np.empty(4, dtype=np.float32)
    others = images[1:]
    cells = np.ascontiguousarray(others.reshape(4, -1).T)
    fill_differences(cells, (others < VACANT).sum(axis=(1, 2)).astype(np.float32), seen, bound, out)
    difference = np.minimum(np.abs(others.astype(np.float64) - seen), bound) ** 2
    np.testing.assert_allclose(out, difference.sum(axis=(1, 2)), rtol=1e-4)


def test_people_are_within_their_limits_and_seen_from_all_sides() -> None:
    """All angles of the file are those of joints; as many people face each quarter."""
    poses = people_poses(MODEL, 3_000)
    low, high = MODEL.limits.T
    assert np.all((poses >= low) & (poses <= high))
    assert not poses[:, :3].any()
    facing = np.array([euler_matrix(pose[3:6])[:, 2] for pose in poses])
    quarters = np.histogram(np.arctan2(facing[:, 0], facing[:, 2]), bins=4, range=(-np.pi, np.pi))[0]
    assert quarters.min() > 0.15 * len(poses)


@pytest.mark.parametrize("lower", [{}, SITTING], ids=["stands", "sits"])
@pytest.mark.parametrize("turn", [0.0, 2.0, -1.2])
def test_a_person_resembles_poses_of_the_library(lower: dict[str, float], turn: float) -> None:
    """Of a person who raises an arm, a match is nearer than half of the distance of an average pose."""
    library = describe_poses(MODEL, people_poses(MODEL, 3_000), CELL, SearchSettings())
    pose = name_pose(MODEL, {**lower, "root_ry": turn, "r_shoulder_abduct": 1.2, "r_elbow_flexion": 0.6})
    pose[:3] = 0.1, 0.0, 2.8
    matches, _ = library.match(visible_points(MODEL, pose), [1.0], 0.0, 100)
    found, anything, there = (around_pelvis(each) for each in (matches, library.poses, pose[None]))
    off, usual = (np.linalg.norm(each - there, axis=-1).mean(axis=1) for each in (found, anything))
    assert off.min() < 0.5 * np.mean(usual)


def around_pelvis(poses: Array) -> Array:
    """Joints (N, J, 3) relative to the pelvis."""
    joints = joint_positions(MODEL, poses)
    return joints - joints[:, :1]


@pytest.mark.parametrize("roll", [0.0, 0.5 * np.pi])
def test_a_pose_of_the_library_is_the_one_most_like_itself(roll: float) -> None:
    """Seen at any place, turned by the given roll, it comes first, at its place and its size."""
    library = describe_poses(MODEL, people_poses(MODEL, 200), CELL, SearchSettings())
    place = np.array([0.3, -0.2, 3.0])
    turn = rotation_to_optical_axis(place, roll)
    for n in range(0, 200, 9):
        visible = visible_points(MODEL, library.poses[n])
        middle = visible.mean(axis=0)
        poses, scales = library.match((visible - middle) @ turn + place, [0.9, 1.0], roll, 3)
        shown = (joint_positions(MODEL, library.poses[n : n + 1])[0] - middle) @ turn + place
        np.testing.assert_allclose(joint_positions(MODEL, poses[:1])[0], shown, atol=CELL)
        assert scales[0] == 1


def visible_points(model: BodyModel, pose: Array) -> Array:
    """The vertices of a pose that lie in front: at most 3 cm behind the nearest of their cell."""
    points = pose_vertices(model, pose[None])[0]
    cell = np.unique(np.floor(points[:, :2] / 0.03), axis=0, return_inverse=True)[1]
    nearest = np.full(cell.max() + 1, np.inf)
    np.minimum.at(nearest, cell, points[:, 2])
    return np.asarray(points[points[:, 2] < nearest[cell] + 0.03])


def test_a_pose_that_was_seen_is_tried_where_points_are_seen_now() -> None:
    """In four turns, one of which is the pose itself, moved."""
    pose = name_pose(MODEL, STANDING)
    moved = pose.copy()
    moved[[0, 2]] += (0.5, 0.4)
    tried = at_quarter_turns(MODEL, pose, visible_points(MODEL, moved), CELL, SearchSettings())
    off = joint_positions(MODEL, tried) - joint_positions(MODEL, moved[None])
    assert len(tried) == 4
    assert np.linalg.norm(off, axis=-1).mean(axis=1).min() < 0.12
