"""Forward kinematics and relative motion: Eq. 1 as a product of matrices, Eq. 2 as its derivative."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, TRANSLATION, BodyModel
from gepf.common.kinematics import (
    difference,
    dof_transforms,
    joint_positions,
    link_transforms,
    natural_angles,
    pose_vertices,
    retract,
    within_limits,
)
from tests.support.bodies import moves, puppet, random_body
from tests.support.kernel import plain_path
from tests.support.kernel.plain_path import step_axes

seeds = st.integers(0, 2**32 - 1)


def anybody(seed: int, count: int) -> tuple[BodyModel, Array]:
    """Any body, and any poses or steps (count, D) of it."""
    rng = np.random.default_rng(seed)
    model = random_body(rng)
    return model, rng.normal(size=(count, len(model.dof_names)))


def product_of_matrices(model: BodyModel, pose: Array) -> Array:
    """T_camera_rest (D + 1, 4, 4) after each degree of freedom, and of what nothing moves, last."""
    found = np.tile(np.eye(4), (len(pose) + 1, 1, 1))
    for j, value in enumerate(pose):
        there, turn, back = np.eye(4), np.eye(4), np.eye(4)
        if model.kinds[j] == TRANSLATION:
            turn[:3, 3] = value * model.axes[j]
        else:
            there[:3, 3], back[:3, 3] = model.points[j], -model.points[j]
            turn[:3, :3] = Rotation.from_rotvec(value * model.axes[j]).as_matrix()
        found[j] = found[model.parents[j]] @ there @ turn @ back
    return found


def derivatives(model: BodyModel, poses: Array) -> Array:
    """Derivative (N, D, V, 3) of every vertex by every degree of freedom's step, from Eq. 2."""
    w, q = (a[:, :, None, None] for a in step_axes(model, poses))  # (N, D, 1, 1, 3)
    t_links = link_transforms(model, poses)[:, model.skin_links]  # (N, V, K, 3, 4)
    carried = np.einsum("nvkij,vj->nvki", t_links[..., :3], model.vertices) + t_links[..., 3]
    turned = np.cross(w, carried[:, None] - q)
    motion = np.where((model.kinds == ROTATION)[:, None, None, None], turned, w)  # (N, D, V, K, 3)
    shares = model.skin_weights * moves(model)[:, model.skin_links]  # (D, V, K)
    found: Array = np.einsum("ndvki,dvk->ndvi", motion, shares)
    return found


def finite_differences(model: BodyModel, poses: Array, step: float) -> Array:
    """The same (N, D, V, 3), by moving there and back."""
    columns = []
    for unit in np.eye(len(model.dof_names)):
        steps = np.tile(step * unit, (len(poses), 1))
        ahead, behind = (pose_vertices(model, retract(model, poses, s)) for s in (steps, -steps))
        columns.append((ahead - behind) / (2.0 * step))
    return np.stack(columns, axis=1)


def short(model: BodyModel, steps: Array) -> Array:
    """Steps (N, D) in which no ball turns by half a turn or more."""
    steps = steps.copy()
    for start in model.balls:
        angle = np.linalg.norm(steps[:, start : start + 3], axis=1, keepdims=True)
        steps[:, start : start + 3] *= np.minimum(1.0, 3.1 / np.maximum(angle, 1e-9))
    return steps


@given(seeds)
def test_transforms_are_products_of_homogeneous_matrices(seed: int) -> None:
    """Eq. 1: every degree of freedom turns or shifts about its axis after its parent, on any tree."""
    model, poses = anybody(seed, 1)
    expected = product_of_matrices(model, poses[0])
    np.testing.assert_allclose(dof_transforms(model, poses)[0], expected[:-1, :3], atol=1e-12)
    np.testing.assert_allclose(link_transforms(model, poses)[0], expected[model.link_dofs, :3], atol=1e-12)


@given(seeds)
def test_skin_and_joints_follow_their_links(seed: int) -> None:
    """A vertex is the weighted mean of its positions on its links; a joint moves with its link."""
    model, poses = anybody(seed, 1)
    t_links = product_of_matrices(model, poses[0])[model.link_dofs]
    for v, vertex in enumerate(pose_vertices(model, poses)[0]):
        links = t_links[model.skin_links[v]]
        carried = links @ np.append(model.vertices[v], 1.0)
        np.testing.assert_allclose(vertex, (model.skin_weights[v] @ carried)[:3], atol=1e-12)
    joints = joint_positions(model, poses)[0]
    for joint, link, point in zip(joints, model.joint_links, model.joint_points, strict=True):
        np.testing.assert_allclose(joint, (t_links[link] @ np.append(point, 1.0))[:3], atol=1e-12)


@given(seeds)
def test_axes_of_relative_motion_are_the_derivative(seed: int) -> None:
    """Eq. 2 is the derivative of every vertex under `retract`, for every degree of freedom of any tree."""
    model, poses = anybody(seed, 3)
    expected = finite_differences(model, poses, 1e-5)
    np.testing.assert_allclose(derivatives(model, poses), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-6, 1e-3], ids="{:g} rad off".format)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_derivative_holds_where_euler_angles_are_singular(off: float, sign: float) -> None:
    """At and near +-90 degrees of a ball's second angle, of either hand and the root's, Eq. 2 still holds."""
    model, rng = puppet(), np.random.default_rng(0)
    poses = rng.normal(size=(4, len(model.dof_names)))
    poses[:, model.balls + 1] = sign * (np.pi / 2 - off)
    exact = derivatives(model, poses)
    assert np.abs(exact).max(axis=(0, 2, 3)).min() > 0.1  # every degree of freedom moves something
    np.testing.assert_allclose(exact, finite_differences(model, poses, 1e-4), atol=1e-5)


@given(seeds, st.sampled_from([1e-12, 1e-8, 1e-3, 1.0, 3.0]))
def test_difference_takes_a_step_back(seed: int, size: float) -> None:
    """The difference between a pose and where a step leads is that step, however small."""
    model, drawn = anybody(seed, 6)
    origins, steps = drawn[:3], short(model, size * drawn[3:])
    back = difference(model, origins, retract(model, origins, steps))
    np.testing.assert_allclose(back, steps, rtol=1e-6, atol=1e-11)


@given(seeds)
def test_the_difference_leads_from_one_pose_to_another(seed: int) -> None:
    """A step by the difference of two poses puts the body where the second has it."""
    model, drawn = anybody(seed, 6)
    origins, poses = 2.0 * drawn[:3], 2.0 * drawn[3:]
    reached = retract(model, origins, difference(model, origins, poses))
    np.testing.assert_allclose(link_transforms(model, reached), link_transforms(model, poses), atol=1e-7)


@given(seeds)
def test_balls_turn_by_the_shorter_way(seed: int) -> None:
    """No difference turns a ball by more than half a turn, and both ways are equally long."""
    rng = np.random.default_rng(seed)
    model = puppet()
    one, other = rng.uniform(-9.0, 9.0, size=(2, 5, len(model.dof_names)))
    there, back = difference(model, one, other), difference(model, other, one)
    assert len(model.balls) > 0
    for start in model.balls:
        lengths = np.linalg.norm(there[:, start : start + 3], axis=1)
        assert np.all(lengths <= np.pi + 1e-9)
        np.testing.assert_allclose(there[:, start : start + 3], -back[:, start : start + 3], atol=1e-9)


@given(seeds, st.integers(0, 5))
def test_a_batch_is_its_poses_one_by_one(seed: int, count: int) -> None:
    """Every function gives each particle of a batch, of any size and layout, the very bytes it has alone."""
    model, drawn = anybody(seed, 2 * count)
    poses, steps = np.split(np.asfortranarray(drawn), 2)  # column by column in memory
    functions: dict[str, Callable[[Array, Array], tuple[Array, ...]]] = {
        "transforms": lambda p, _: (dof_transforms(model, p),),
        "axes": lambda p, _: step_axes(model, p),
        "retract": lambda p, s: (retract(model, p, s),),
        "difference": lambda p, s: (difference(model, p, s),),
    }
    for name, function in functions.items():
        whole = function(poses, steps)
        for n in range(count):
            for together, alone in zip(whole, function(poses[n : n + 1], steps[n : n + 1]), strict=True):
                assert together[n].tobytes() == alone[0].tobytes(), name


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_ball_can_spin_on_for_turns(place: int) -> None:
    """Three turns in small steps about one axis count up to 6 pi, through the singular poses too."""
    model = puppet()
    assert len(model.balls) > 0
    for start in model.balls:
        pose = np.zeros((1, len(model.dof_names)))
        step = np.zeros_like(pose)
        step[0, start + place] = 6.0 * np.pi / 400
        for _ in range(400):
            pose = retract(model, pose, step)
        expected = np.zeros_like(pose)
        expected[0, start + place] = 6.0 * np.pi
        np.testing.assert_allclose(pose, expected, atol=1e-6)


def test_angles_do_not_jump() -> None:
    """In a long sequence no angle jumps by a turn, and away from singular poses it follows the steps."""
    model, rng = puppet(), np.random.default_rng(3)
    pose = np.zeros((1, len(model.dof_names)))
    travelled, calm = 0.0, 0
    for _ in range(3000):
        step = 0.05 * rng.normal(size=pose.shape)
        moved = retract(model, pose, step)
        change = np.abs(moved - pose)[0]
        travelled = max(travelled, float(np.abs(moved[0, model.balls]).max()))
        assert change.max() <= np.pi + 1e-9
        for start in model.balls:
            if abs(np.cos(pose[0, start + 1])) > 0.5:
                calm += 1
                assert (
                    change[start : start + 3].max() < 4.0 * np.linalg.norm(step[0, start : start + 3]) + 1e-12
                )
        pose = moved
    assert travelled > 2.0 * np.pi
    assert calm > 3000


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
