"""A body: a part of its degrees of freedom is active, three rotations form a ball, its content has a hash."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS, ROTATION, TRANSLATION, BodyModel, find_balls
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from tests.support.bodies import flexible_puppet, person, puppet

seeds = st.integers(0, 2**32 - 1)


def choose(model: BodyModel, rng: np.random.Generator) -> tuple[list[str], Array, Array]:
    """Some names in any order, values of the others, and the whole pose (D,) with values of all."""
    pose = rng.normal(scale=0.7, size=len(model.dof_names))
    names = [str(name) for name in rng.permutation(np.array(model.dof_names))[: rng.integers(len(pose) + 1)]]
    held = np.array(
        [0.0 if name in names else value for name, value in zip(model.dof_names, pose, strict=True)]
    )
    return names, held, pose


def values(model: BodyModel, full: BodyModel, pose: Array) -> Array:
    """The pose (1, D') of a part of the body from the pose (D,) of the whole."""
    return pose[None, [full.dof(name) for name in model.dof_names]]


@pytest.mark.parametrize("body", [puppet, flexible_puppet])
@given(seed=seeds)
def test_a_part_moves_the_body_as_the_whole_does(body: Callable[..., BodyModel], seed: int) -> None:
    """Any subset, the others held at any pose: the same values place all vertices and joints alike.

    With the others at zero, skin that links share moves the same too. Shape coefficients are no exception.
    """
    full = body(blended=False)
    names, held, pose = choose(full, np.random.default_rng(seed))
    part = activate(full, names, held)
    assert part.dof_names == tuple(name for name in full.dof_names if name in names)
    for place in (pose_vertices, joint_positions):
        np.testing.assert_allclose(place(part, values(part, full, pose)), place(full, pose[None]), atol=1e-12)
    full, pose = body(), np.where(held == 0.0, pose, 0.0)
    part = activate(full, names, np.zeros_like(pose))
    moved = pose_vertices(part, values(part, full, pose))
    assert len(names) == 0 or np.abs(moved[0] - full.vertices).max() > 1e-3
    np.testing.assert_allclose(moved, pose_vertices(full, pose[None]), atol=1e-12)


def test_the_held_pose_becomes_the_rest_pose() -> None:
    """A hinge held bent is bent at rest, including blended skin, for any values of the active ones."""
    full = puppet()
    held = np.zeros(len(full.dof_names))
    held[full.dof("l_elbow")] = -1.2
    bent = pose_vertices(full, held[None])[0]
    held[full.dof("r_elbow")] = 0.7
    part = activate(full, ["r_elbow"], held)
    np.testing.assert_allclose(part.vertices, bent, atol=1e-12)
    assert np.abs(part.vertices - full.vertices).max() > 0.2


def test_links_that_move_as_one_are_merged() -> None:
    """With one hinge active there is the link that it moves and all the rest; limits and names stay."""
    full = puppet()
    part = activate(full, ["l_elbow"], np.zeros(len(full.dof_names)))
    assert part.link_dofs.tolist() == [-1, 0]
    assert part.parents.tolist() == [-1]
    np.testing.assert_array_equal(part.limits, full.limits[[full.dof("l_elbow")]])
    assert part.joint_names == full.joint_names
    fore = full.joint_names.index("l_fore")
    assert part.joint_links.tolist() == [int(j == fore) for j in range(len(full.joint_names))]


def test_a_ball_stays_one_only_as_a_whole() -> None:
    """All three rotations of a shoulder make a ball; two of them are single axes."""
    full = puppet()
    rest = np.zeros(len(full.dof_names))
    assert activate(full, ["r_arm_3", "r_arm_1", "r_arm_2"], rest).balls.tolist() == [0]
    assert activate(full, ["r_arm_1", "r_arm_2", "l_arm_3"], rest).balls.tolist() == []


def test_the_same_content_has_the_same_hash() -> None:
    """The hash depends on content alone: not on which object, nor on how its arrays lie in memory."""
    model = puppet()
    turned = replace(model, vertices=np.asfortranarray(model.vertices))
    assert replace(model).hash == model.hash == turned.hash
    assert activate(human(), DEFAULT_ACTIVE, np.zeros(186)).hash == person().hash


@pytest.mark.parametrize("name", [field.name for field in fields(BodyModel)])
def test_any_change_of_content_changes_the_hash(name: str) -> None:
    """Every field counts."""
    model = puppet()
    value = getattr(model, name)
    if isinstance(value, str):
        other: Any = value + "'"
    elif isinstance(value, tuple):
        other = (value[0] + "'", *value[1:])
    elif name == "axes":
        other = -value
    elif name == "skin_weights":
        other = value[:, ::-1]
    elif name == "kinds":  # no shape coefficients without their directions
        other = 1 - value
    elif name.startswith("shape_"):
        model = flexible_puppet()
        other = 2.0 * getattr(model, name)
    elif name.startswith("keypoint_"):
        model = puppet_with_keypoints()
        value = getattr(model, name)
        other = value[::-1] if name == "keypoint_links" else value[:, ::-1]
    elif name in {"parents", "link_dofs"}:
        other = np.where(np.arange(len(value)) == len(value) - 1, -1, value)
    else:
        other = value + np.ones_like(value)
    assert replace(model, **{name: other}).hash != model.hash


def puppet_with_keypoints() -> BodyModel:
    """The puppet with keypoints, each between two vertices."""
    count = len(KEYPOINTS)
    return replace(
        puppet(),
        keypoint_links=np.arange(count) % 3,
        keypoint_vertices=np.arange(2 * count).reshape(count, 2),
        keypoint_shares=np.tile([0.3, 0.7], (count, 1)),
    )


def test_a_models_arrays_are_its_own_and_frozen() -> None:
    """No array can be written to, and changing what a model was made from does not change the model."""
    vertices = puppet().vertices.copy()
    model = replace(puppet(), vertices=vertices)
    vertices[0] = 99.0
    assert not np.any(model.vertices == 99.0)
    arrays = [getattr(model, field.name) for field in fields(model)]
    arrays = [array for array in arrays if isinstance(array, np.ndarray)]
    assert len(arrays) == 20
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parents": np.arange(19)}, "before"),
        ({"limits": np.zeros((3, 2))}, "limits"),
        ({"link_dofs": np.full(8, 19)}, "link"),
        ({"axes": np.full((19, 3), 0.9)}, "unit"),
        ({"skin_weights": np.full((8 * 162, 2), 0.6)}, "sum to 1"),
        *(
            ({"rest_spreads": np.r_[np.ones(18), wrong]}, "rest_spreads must be")
            for wrong in (0.0, -1.0, np.nan)
        ),
        ({"rest_spreads": np.where(np.arange(19) == 6, 2.0, 1.0)}, "three angles of a spherical joint"),
    ],
)
def test_a_model_that_contradicts_itself_is_refused(change: dict[str, Any], message: str) -> None:
    """The error says what does not fit."""
    with pytest.raises(ValueError, match=message):
        replace(puppet(), **change)


THROUGH_ONE_POINT = np.zeros((4, 3))


def balls_of(
    parents: list[int], carriers: list[int], axes: Array | None = None, kinds: list[int] | None = None
) -> list[int]:
    """Balls among rotations about x, y, z and x again."""
    count = len(parents)
    balls = find_balls(
        np.array(kinds or [ROTATION] * count, dtype=np.int64),
        np.array(parents, dtype=np.int64),
        np.eye(3)[np.arange(count) % 3] if axes is None else axes,
        THROUGH_ONE_POINT[:count],
        np.array(carriers, dtype=np.int64),
    )
    return [int(ball) for ball in balls]


SLANTED = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("balls", "found"),
    [
        (balls_of([-1, 0, 1], [2]), [0]),  # a shoulder: one link, on the last of the three
        (balls_of([-1, 0, 1], [0, 2]), []),  # a robot's wrist: what hangs on the first axis moves on its own
        (balls_of([-1, 0, 1], [1, 2]), []),
        (balls_of([-1, 0, 1, 0], [2, 3]), []),  # a second child of the first axis
        (balls_of([-1, 0, 1, 1], [2, 3]), []),
        (balls_of([-1, 0, 1], [2], SLANTED), []),
        (balls_of([-1, 0, 1], [2], kinds=[ROTATION, TRANSLATION, ROTATION]), []),
    ],
)
def test_three_rotations_in_one_point_with_nothing_in_between_are_a_ball(
    balls: list[int], found: list[int]
) -> None:
    """Only orthonormal axes are solved as one turn, and only where no surface or joint is in between."""
    assert balls == found
