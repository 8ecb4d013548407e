"""The human template: closed symmetric surface, all of MPEG-4's angles, signs, proportions."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.activation import activate
from gepf.common.arrays import Array, Indices
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.dofs import JOINT_ANGLES
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human

SIDES = {"left": "l", "right": "r"}
LEFTWARD, FORWARD, UPWARD = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)
SQUAT = {"hip_flexion": 2.0, "knee_flexion": 2.3, "ankle_flexion": 0.4, "shoulder_flexion": 1.5}


@pytest.fixture(scope="module")
def model() -> BodyModel:
    """A person of 1.75 m."""
    return human(1.75)


def posed(model: BodyModel, angles: dict[str, float]) -> Array:
    """A pose (1, D) with these angles in radians and all others zero; names without a side mean both."""
    pose = np.zeros((1, len(model.dof_names)))
    for name, angle in angles.items():
        for dof in [name] if name in model.dof_names else [f"l_{name}", f"r_{name}"]:
            pose[0, model.dof(dof)] = angle
    return pose


def joints_at(model: BodyModel, angles: dict[str, float]) -> dict[str, Array]:
    """Named joints (3,) in a pose."""
    return dict(zip(model.joint_names, joint_positions(model, posed(model, angles))[0], strict=True))


def directed_edges(triangles: Indices) -> Indices:
    """All three edges of each triangle, in its direction, (3T, 2)."""
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def volume(vertices: Array, triangles: Indices) -> float:
    """Volume enclosed, positive where triangles are counter-clockwise from outside."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6.0)


def test_every_parameter_of_mpeg4_is_a_degree_of_freedom(model: BodyModel) -> None:
    """All 180 angles, in the order of ISO/IEC 14496-2, each once, after the root's degrees of freedom."""
    assert sorted(model.dof_names[6:]) == sorted(JOINT_ANGLES)
    numbered = {1: "sacroiliac_tilt", 10: "l_knee_flexion", 37: "r_shoulder_twisting", 122: "vl5_tilt"}
    assert {number: JOINT_ANGLES[number - 1] for number in numbered} == numbered
    assert model.dof_names[:6] == DEFAULT_ACTIVE[:6]


def test_the_papers_degrees_of_freedom_can_be_activated(model: BodyModel) -> None:
    """The 24 of the paper leave a body with its five balls and the same rest pose."""
    body = activate(model, DEFAULT_ACTIVE, np.zeros(len(model.dof_names)))
    assert body.dof_names[:6] == DEFAULT_ACTIVE[:6]
    assert set(body.dof_names) == set(DEFAULT_ACTIVE)
    assert len(DEFAULT_ACTIVE) == 24
    assert len(body.balls) == 5
    np.testing.assert_allclose(body.vertices, model.vertices, atol=1e-12)


@pytest.mark.parametrize("girth", [0.85, 1.0, 1.25])
def test_the_surface_is_closed(girth: float) -> None:
    """Each edge occurs once in each direction, in one piece without handles, slim or stout."""
    body = human(1.75, girth)
    edges = directed_edges(body.triangles)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(e) for e in edges.tolist()} == {tuple(e) for e in edges[:, ::-1].tolist()}
    assert len(body.vertices) - len(edges) // 2 + len(body.triangles) == 2
    assert np.array_equal(np.unique(body.triangles), np.arange(len(body.vertices)))


def test_the_surface_has_the_size_and_grain_of_a_person(model: BodyModel) -> None:
    """Volume of a 75 kg person, stature from sole to crown, vertices about 4 cm apart."""
    assert 0.065 < volume(model.vertices, model.triangles) < 0.085
    assert 1.73 < np.ptp(model.vertices[:, 1]) < 1.77
    assert 1500 < len(model.vertices) < 3000
    edges = directed_edges(model.triangles)
    lengths = np.linalg.norm(model.vertices[edges[:, 0]] - model.vertices[edges[:, 1]], axis=1)
    assert np.all((np.percentile(lengths, [1, 99]) > 0.01) & (np.percentile(lengths, [1, 99]) < 0.06))


def test_left_and_right_are_mirror_images(model: BodyModel) -> None:
    """Each vertex and each joint has its counterpart on the other side."""
    place = {tuple(v) for v in np.round(model.vertices, 9) + 0.0}
    assert place == {tuple(v) for v in np.round(model.vertices * (-1.0, 1.0, 1.0), 9) + 0.0}
    joints = joints_at(model, {})
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        mirrored = joints[f"right_{name}"] * (-1.0, 1.0, 1.0)
        np.testing.assert_allclose(joints[f"left_{name}"], mirrored, atol=1e-12)


@pytest.mark.parametrize("word", SIDES)
@pytest.mark.parametrize(
    ("motion", "joint", "outward", "up", "forward"),
    [
        ("shoulder_flexion", "wrist", 0.0, 0.05, 0.2),
        ("shoulder_abduct", "wrist", 0.2, 0.1, 0.0),
        ("elbow_flexion", "wrist", 0.0, 0.03, 0.1),
        ("hip_flexion", "ankle", 0.0, 0.08, 0.3),
        ("hip_abduct", "ankle", 0.3, 0.1, 0.0),
        ("knee_flexion", "ankle", 0.0, 0.03, -0.19),
        ("sternoclavicular_abduct", "shoulder", 0.0, 0.05, 0.0),
        ("sternoclavicular_rotate", "shoulder", 0.0, 0.0, 0.05),
    ],
)
def test_positive_angles_move_limbs_as_documented(
    model: BodyModel, word: str, motion: str, joint: str, outward: float, up: float, forward: float
) -> None:
    """Half a radian moves the joint at least this far in metres (0: no condition on that axis)."""
    moved = joints_at(model, {f"{SIDES[word]}_{motion}": 0.5})[f"{word}_{joint}"]
    step = moved - joints_at(model, {})[f"{word}_{joint}"]
    side = 1.0 if word == "left" else -1.0
    for least, way in (
        (outward, side * np.array(LEFTWARD)),
        (up, np.array(UPWARD)),
        (forward, np.array(FORWARD)),
    ):
        assert least == 0.0 or np.sign(least) * (step @ way) >= abs(least)


@pytest.mark.parametrize("word", SIDES)
@pytest.mark.parametrize(("limb", "joint"), [("shoulder", "wrist"), ("hip", "ankle")])
def test_twisting_turns_inward(model: BodyModel, word: str, limb: str, joint: str) -> None:
    """With elbow and knee bent by a right angle, twisting moves the forearm inward, the shank outward."""
    bend = {"shoulder": "elbow_flexion", "hip": "knee_flexion"}[limb]
    side = SIDES[word]
    bent = {f"{side}_{bend}": np.pi / 2}
    step = joints_at(model, {**bent, f"{side}_{limb}_twisting": 0.5})[f"{word}_{joint}"]
    step = step - joints_at(model, bent)[f"{word}_{joint}"]
    inward = -1.0 if word == "left" else 1.0
    assert inward * step[0] > 0.1 if limb == "shoulder" else inward * step[0] < -0.1


@pytest.mark.parametrize("vertebra", ["sacroiliac", "vl3", "vt8"])
@pytest.mark.parametrize(
    ("motion", "joint", "way"),
    [("tilt", "head", FORWARD), ("roll", "head", (-1.0, 0.0, 0.0)), ("torsion", "right_shoulder", FORWARD)],
)
def test_the_trunk_bends_forward_and_to_the_right_and_turns_to_the_left(
    model: BodyModel, vertebra: str, motion: str, joint: str, way: tuple[float, float, float]
) -> None:
    """Tilt brings the head forward, roll to the right, torsion the right shoulder forward; the legs stay."""
    rest, bent = joints_at(model, {}), joints_at(model, {f"{vertebra}_{motion}": 0.5})
    assert (bent[joint] - rest[joint]) @ np.array(way) > 0.05
    np.testing.assert_allclose(bent["left_knee"], rest["left_knee"], atol=1e-12)


def test_a_squat_keeps_the_volume(model: BodyModel) -> None:
    """Deeply bent joints leave the surface near its volume."""
    vertices, whole = pose_vertices(model, posed(model, SQUAT))[0], volume(model.vertices, model.triangles)
    assert volume(vertices, model.triangles) == pytest.approx(whole, rel=0.1)


def test_single_measures_can_be_set() -> None:
    """A longer thigh lengthens the thigh alone; girth leaves all bones as they are."""
    usual, long, stout = human(1.75), human(1.75, thigh=0.47), human(1.75, girth=1.2)
    joints, longer = joints_at(usual, {}), joints_at(long, {})
    assert np.linalg.norm(longer["left_knee"] - longer["left_hip"]) == pytest.approx(0.47, abs=0.001)
    shanks = [each["left_ankle"] - each["left_knee"] for each in (longer, joints)]
    np.testing.assert_allclose(shanks[0], shanks[1], atol=1e-9)
    np.testing.assert_allclose(stout.joint_points, usual.joint_points)
    assert volume(stout.vertices, stout.triangles) > 1.2 * volume(usual.vertices, usual.triangles)
