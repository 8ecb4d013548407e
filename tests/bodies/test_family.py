"""Families of bodies: laws that hold for each of them, and that nothing else knows what they know."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.choice import choose_bodies, load_body
from gepf.coordinator.bodies.families import FAMILIES, angles_of, family_of
from gepf.coordinator.bodies.human.dofs import JOINT_ANGLES
from gepf.coordinator.bodies.human.shape_space import NAMED_JOINTS

ROOT = Path(__file__).parents[2]
MODELS = {"human": "human", "mechanism": str(ROOT / "examples" / "arm7.urdf")}
OF_PEOPLE = {
    "coordinator/colour/keypoints.py",  # landmarks of a network for people
    "coordinator/exports/opensim.py",  # a model of people
    "coordinator/results/ros_humans.py",  # REP 155
    "coordinator/synthesis",  # scenes with people
    "coordinator/bodies/human",
}


@pytest.fixture(params=MODELS)
def model(request: pytest.FixtureRequest) -> BodyModel:
    """A body of each family, with the degrees of freedom for detection."""
    bodies = choose_bodies(None, "default", MODELS[request.param])
    return bodies.for_start(*bodies.library_size)


def test_every_family_is_tested() -> None:
    """A new one needs a model here."""
    assert MODELS.keys() == {family.name for family in FAMILIES}


def test_a_body_knows_its_family(model: BodyModel) -> None:
    """Also with fewer degrees of freedom, from which its angles follow."""
    family = family_of(model)
    assert family_of(load_body(MODELS[family.name])) is family
    assert angles_of(model).names == family.angles(model, {}, None).names


def test_start_poses_are_within_limits_and_at_the_origin(model: BodyModel) -> None:
    """The same every time; the whole root is free to be placed."""
    family = family_of(model)
    poses, again = (family.draw_poses(model, 50, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(poses, again)
    low, high = model.limits.T
    assert np.all((poses >= low) & (poses <= high))
    assert not poses[:, model.root[:3]].any()
    assert np.ptp(poses[:, model.root[3:]], axis=0).min() > 0.5


def test_the_roll_of_a_body_turns_with_the_image(model: BodyModel) -> None:
    """By quarters, from any pose; None in every pose of a body that has no upright posture."""
    family, pose = family_of(model), np.zeros(len(model.dof_names))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rolls = [family.roll(model, pose, np.linalg.matrix_power(quarter, n)) for n in range(4)]
    if family.axis is None:
        assert rolls == [None] * 4
    else:
        assert np.degrees(np.array(rolls, dtype=float)).round().tolist() == [0.0, 270.0, 180.0, 90.0]


def test_a_body_faces_away_if_it_is_turned_round(model: BodyModel) -> None:
    """Of bodies without sides none does."""
    family, poses = family_of(model), np.zeros((2, len(model.dof_names)))
    poses[1, model.root[4]] = np.pi
    joints = joint_positions(model, poses)
    away = family.faces_away(model.joint_names, joints, joints[0])
    assert away.tolist() == [False, bool(family.sides)]


def test_a_body_of_an_unknown_family_is_refused(model: BodyModel) -> None:
    """A run of another version says which families this one knows."""
    with pytest.raises(InputError, match=r"unknown family 'octopus'.*human.*use the version"):
        family_of(replace(model, family="octopus"))


def test_nothing_but_the_family_names_joints_of_people() -> None:
    """No string in other code is a joint or an angle of a person, but in formats and scenes of people.

    Another family may have a joint of the same name.
    """
    names = {*NAMED_JOINTS, *JOINT_ANGLES}
    found = []
    for file in sorted((ROOT / "coordinator").rglob("*.py")):
        path, text = file.relative_to(ROOT), file.read_text(encoding="utf-8")
        if OF_PEOPLE.isdisjoint(map(str, [path, *path.parents])) and "(BodyFamily)" not in text:
            nodes = ast.walk(ast.parse(text))
            found += [f"{path}: {n.value}" for n in nodes if isinstance(n, ast.Constant) and n.value in names]
    assert not found
