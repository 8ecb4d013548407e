"""The library of poses: its descriptors, and which of its poses look like what is observed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.human.typical_poses import draw_people
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.tracking.descriptor import COLUMNS, ROWS, VACANT, describe, fill_differences
from gepf.coordinator.tracking.pose_library import describe_poses, displaced, look_straight
from tests.support.people import STANDING

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


def test_people_are_drawn_within_their_limits_and_from_all_sides() -> None:
    """The same every time, from a generator of the library's own."""
    poses = draw_people(MODEL, 500, np.random.default_rng(3))
    np.testing.assert_array_equal(poses, draw_people(MODEL, 500, np.random.default_rng(3)))
    low, high = MODEL.limits.T
    assert np.all((poses >= low) & (poses <= high))
    assert np.histogram(poses[:, 4], bins=4, range=(-np.pi, np.pi))[0].min() > 60


@pytest.mark.parametrize("roll", [0.0, 0.5 * np.pi])
def test_a_pose_of_the_library_is_the_one_most_like_itself(roll: float) -> None:
    """Seen at any place, turned by the given roll, it comes first, at its place and its size."""
    library = describe_poses(MODEL, draw_people(MODEL, 200, np.random.default_rng(5)), CELL)
    place = np.array([0.3, -0.2, 3.0])
    for n in (0, 17, 101):
        turn = look_straight(place, roll)
        visible = visible_points(MODEL, library.poses[n])
        poses, scales = library.match(visible @ turn + place, [0.9, 1.0], roll, 3)
        shown = joint_positions(MODEL, library.poses[n : n + 1])[0] @ turn + place
        np.testing.assert_allclose(joint_positions(MODEL, poses[:1])[0], shown, atol=0.08)
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
    tried = displaced(MODEL, pose, visible_points(MODEL, moved), CELL)
    off = joint_positions(MODEL, tried) - joint_positions(MODEL, moved[None])
    assert len(tried) == 4
    assert np.linalg.norm(off, axis=-1).mean(axis=1).min() < 0.12
