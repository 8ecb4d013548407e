"""Anatomical angles: meaning, agreement of both sides, continuity; and from joint positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.bodies.human.angles import person_angles
from gepf.coordinator.bodies.human.from_joints import angles_from_joints
from gepf.coordinator.bodies.human.isb import isb_shoulder
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.swing_twist import nearest_swing, swing_twist
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.bodies.urdf import read_urdf

DOWN, LEFT, FRONT = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
ARM = ("l_shoulder_flexion", "l_shoulder_abduct", "l_shoulder_twisting")
ARM_TILT = person_angles(ARM, {}).measure(np.zeros((1, 3)))[0, 1]  # of the hanging arm, radians
turns = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@pytest.fixture(scope="module")
def person() -> BodyModel:
    """A person as the default preset tracks one."""
    model, _ = choose_bodies(None, "default").tracked(Size(1.75, 1.0), {})
    return model


@pytest.fixture(scope="module")
def angles(person: BodyModel) -> Angles:
    """Their angles."""
    return angles_of(person)


def posed(names: tuple[str, ...], **values: float) -> Array:
    """A pose (1, D) with these degrees of freedom in degrees."""
    pose = np.zeros((1, len(names)))
    for name, value in values.items():
        pose[0, names.index(name)] = np.radians(value)
    return pose


def read(angles: Angles, **values: float) -> dict[str, float]:
    """Angles by name, degrees, of a pose in degrees."""
    measured = np.degrees(angles.measure(posed(angles.dof_names, **values)))[0]
    return dict(zip(angles.names, measured.tolist(), strict=True))


@given(turns)
def test_swing_after_twist_is_the_rotation(quaternion: tuple[float, ...]) -> None:
    """Swing and twist together are the original rotation.

    The ISB's plane, elevation and axial rotation, in the order Y, X, Y, are the original rotation, too.
    """
    rotation = Rotation.from_quat([quaternion])
    swing, twist = swing_twist(rotation.as_quat())
    across = np.stack([swing[:, 0], np.zeros(1), swing[:, 1]], axis=1)
    again = Rotation.from_rotvec(across) * Rotation.from_rotvec(twist[:, None] * DOWN)
    assert (again * rotation.inv()).magnitude()[0] < 1e-7
    assert abs(twist[0]) <= np.pi
    assert np.linalg.norm(swing) <= np.pi + 1e-9
    plane, elevation, axial = isb_shoulder(np.concatenate([-swing, twist[:, None]], axis=1))[0]
    # ISB's axes of a right arm are (front, up, right); ours, mirrored, (left, down, back)
    again = (
        Rotation.from_rotvec(plane * DOWN)
        * Rotation.from_rotvec([0.0, 0.0, -elevation])
        * Rotation.from_rotvec(axial * DOWN)
    )
    assert (again * rotation.inv()).magnitude()[0] < 1e-7


@given(turns, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.booleans())
def test_the_nearest_swing_is_the_same_swing(
    quaternion: tuple[float, ...], x: float, z: float, limb: bool
) -> None:
    """Near any other swing, a swing turns the bone to the same direction, by at most 270 degrees."""
    swing, _ = swing_twist(Rotation.from_quat([quaternion]).as_quat())
    near = nearest_swing(swing, np.array([[x, z]]), limb)
    placed = [Rotation.from_rotvec([s[0, 0], 0.0, s[0, 1]]).apply(DOWN) for s in (swing, near)]
    assert np.allclose(placed[0], placed[1], atol=1e-6)
    assert np.linalg.norm(near) <= np.radians(270.0) + 1e-9


@pytest.mark.parametrize(
    ("dof", "angle"),
    [
        ("r_shoulder_twisting", "right_shoulder_rotation"),
        ("l_hip_flexion", "left_hip_flexion"),
        ("r_hip_abduct", "right_hip_abduction"),
        ("l_hip_twisting", "left_hip_rotation"),
        ("r_knee_flexion", "right_knee_flexion"),
        ("l_ankle_flexion", "left_ankle_flexion"),
        ("r_elbow_flexion", "right_elbow_flexion"),
        ("vl3_tilt", "trunk_flexion"),
        ("vl3_roll", "trunk_side_bending"),
        ("vl3_torsion", "trunk_rotation"),
        ("root_rx", "pelvis_forward_tilt"),
    ],
)
def test_one_joint_moved_is_one_angle(angles: Angles, dof: str, angle: str) -> None:
    """A degree of freedom that moves alone changes its own angle and no other."""
    rest, moved = read(angles), read(angles, **{dof: 30.0})
    changed = {name for name in moved if abs(moved[name] - rest[name]) > 1e-6}
    assert changed == {angle}
    assert moved[angle] == pytest.approx(30.0)


def test_swings_are_where_the_bone_points(person: BodyModel, angles: Angles) -> None:
    """In any pose, flexion and abduction turn the vertical into the line from shoulder to elbow."""
    poses = np.random.default_rng(3).uniform(-1.2, 1.2, (40, len(person.dof_names)))
    poses[:, :6] = 0.0
    for name in ("vl3_tilt", "vl3_roll", "vl3_torsion"):
        poses[:, person.dof(name)] = 0.0
    joints, found = joint_positions(person, poses), angles.measure(poses)
    for side, out in (("left", 1.0), ("right", -1.0)):
        at = [person.joint_names.index(f"{side}_{joint}") for joint in ("shoulder", "elbow")]
        bone = joints[:, at[1]] - joints[:, at[0]]
        flexion, abduction = (
            found[:, angles.names.index(f"{side}_shoulder_{name}")] for name in ("flexion", "abduction")
        )
        swing = np.stack([-flexion, 0.0 * flexion, -abduction], axis=1)
        pointed = Rotation.from_rotvec(swing).apply(DOWN) * [out, 1.0, 1.0]
        assert np.allclose(bone / np.linalg.norm(bone, axis=1, keepdims=True), pointed, atol=1e-9)


@given(st.tuples(*[st.floats(-170.0, 170.0)] * 3), st.sampled_from(["shoulder", "hip"]))
def test_both_sides_mean_the_same(values: tuple[float, float, float], joint: str) -> None:
    """Equal joint values left and right are equal angles, of ball joints too."""
    motions = ("flexion", "abduct", "twisting")
    given_ = {f"{s}_{joint}_{m}": v for s in "lr" for m, v in zip(motions, values, strict=True)}
    found = read(person_angles(tuple(given_), {}), **given_)
    for name in ("flexion", "abduction", "rotation"):
        assert found[f"left_{joint}_{name}"] == pytest.approx(found[f"right_{joint}_{name}"], abs=1e-6)


def left_arm(turned: Rotation, dof_names: tuple[str, ...]) -> Array:
    """Poses (F, D) in which the left upper arm, hanging straight down before, has these rotations (F,)."""
    tilt = Rotation.from_rotvec([0.0, 0.0, -ARM_TILT])
    axes = tilt.apply([-LEFT, FRONT, DOWN])
    inside = axes @ (turned * tilt.inv()).as_matrix() @ axes.T
    poses = np.zeros((len(inside), len(dof_names)))
    for a, motion in enumerate(("flexion", "abduct", "twisting")):
        euler = -np.unwrap(Rotation.from_matrix(inside).as_euler("XYZ"), axis=0)
        poses[:, dof_names.index(f"l_shoulder_{motion}")] = euler[:, a]
    return poses


def test_euler_angles_jump_where_these_do_not(angles: Angles) -> None:
    """An abducted arm that moves by a few degrees: its Euler angles jump by 30 in a frame, these by 3."""
    t = np.radians(np.linspace(-20.0, 20.0, 41))
    raised = Rotation.from_rotvec((ARM_TILT + np.radians(89.7)) * FRONT)
    poses = left_arm(Rotation.from_rotvec(t[:, None] * LEFT) * raised, angles.dof_names)
    assert np.degrees(np.abs(np.diff(poses, axis=0)).max()) > 15.0
    assert np.degrees(np.abs(np.diff(angles.follow(angles.measure(poses)), axis=0)).max()) < 3.0


def test_an_arm_swung_over_the_head_goes_on(angles: Angles) -> None:
    """Straight through the one singular direction, flexion passes 180 degrees without a jump."""
    t = np.radians(np.linspace(0.0, 220.0, 60))
    found = np.degrees(
        angles.follow(angles.measure(left_arm(Rotation.from_rotvec(-t[:, None] * LEFT), angles.dof_names)))
    )
    assert np.abs(np.diff(found, axis=0)).max() < 4.0
    assert found[-1, angles.names.index("left_shoulder_flexion")] == pytest.approx(220.0)


@pytest.mark.parametrize("cone", [15.0, 25.0, 40.0])
def test_a_swing_that_goes_round_the_vertical_never_leaps(cone: float) -> None:
    """An arm that circles over the head has small steps: only a jump is compared with the range of limbs."""
    round_it = np.radians(np.linspace(0.0, 360.0, 73))
    bone = np.stack([np.cos(round_it), np.zeros(73), np.sin(round_it)], axis=1)
    across = Rotation.from_rotvec(bone * np.radians(180.0 - cone))
    swings, _ = swing_twist(across.as_quat())
    followed = [swings[:1]]
    for swing in swings[1:]:
        followed.append(nearest_swing(swing[None], followed[-1], limb=True))
    steps = np.abs(np.diff(np.degrees(np.concatenate(followed)), axis=0))
    assert steps.max() < 20.0


def test_a_person_who_turns_twice_has_turned_720_degrees(angles: Angles) -> None:
    """The turn of the pelvis is continuous, and forward tilt is relative to the person's own front."""
    poses = np.zeros((100, len(angles.dof_names)))
    poses[:, angles.dof_names.index("root_ry")] = -np.radians(np.linspace(0.0, 720.0, 100))
    found = np.degrees(angles.follow(angles.measure(poses)))
    assert found[-1, angles.names.index("pelvis_turn")] == pytest.approx(720.0)
    bent = Rotation.from_euler("YX", [[90.0, 20.0]], degrees=True).as_euler("XYZ")[0]
    pose = np.zeros((1, len(angles.dof_names)))
    pose[0, 3:6] = bent
    tilted = dict(zip(angles.names, np.degrees(angles.measure(pose))[0], strict=True))
    assert tilted["pelvis_forward_tilt"] == pytest.approx(20.0)
    assert tilted["pelvis_turn"] == pytest.approx(-90.0)
    assert tilted["pelvis_side_tilt"] == pytest.approx(0.0, abs=1e-6)


def test_a_neck_that_only_tilts_has_one_angle() -> None:
    """Without a tracked turn there is one angle; with a held turn there are all three."""
    angles = person_angles((*ROOT_DOFS, "vc7_tilt", "l_elbow_flexion"), {})
    assert [name for name in angles.names if name.startswith("neck")] == ["neck_flexion"]
    pose = np.zeros((1, 8))
    pose[0, 6] = 0.5
    assert angles.measure(pose)[0, angles.names.index("neck_flexion")] == pytest.approx(0.5)
    held = person_angles(("vc7_tilt",), {"vc7_torsion": 0.3})
    assert len([name for name in held.names if name.startswith("neck")]) == 3


def test_what_is_held_counts() -> None:
    """With flexion held and abduction tracked, the angles are those of both moved."""
    part = person_angles(("r_shoulder_abduct",), {"r_shoulder_flexion": 0.7})
    values = {"r_shoulder_flexion": np.degrees(0.7), "r_shoulder_abduct": np.degrees(0.4)}
    both = read(person_angles(tuple(values), {}), **values)
    assert part.names == tuple(f"right_shoulder_{name}" for name in ("flexion", "abduction", "rotation"))
    assert np.allclose(np.degrees(part.measure(np.array([[0.4]])))[0], [both[name] for name in part.names])


def test_a_robots_angles_are_its_joints() -> None:
    """A URDF arm has the turn of its base, and its joints by their own names and values."""
    arm = read_urdf(Path(__file__).parents[2] / "examples" / "arm7.urdf")
    angles, pose = angles_of(arm), np.linspace(0.0, 0.9, len(arm.dof_names))
    found = dict(zip(angles.names, angles.measure(pose[None])[0], strict=True))
    assert angles.names[:3] == ("base_forward_tilt", "base_side_tilt", "base_turn")
    assert {name: found[name] for name in arm.dof_names[6:]} == dict(
        zip(arm.dof_names[6:], pose[6:], strict=True)
    )


@pytest.mark.parametrize("backward", [20.0, 30.0, 80.0])
def test_an_arm_found_again_over_the_head_is_not_said_to_be_behind(angles: Angles, backward: float) -> None:
    """A jump from behind the trunk to over the head: the shorter way is backward, which no arm can move."""
    flexions = np.radians([-backward, 160.0, 130.0, 100.0, 70.0])
    poses = np.zeros((5, len(angles.dof_names)))
    poses[:, angles.dof_names.index("r_shoulder_flexion")] = flexions
    found = np.degrees(angles.follow(angles.measure(poses))[:, angles.names.index("right_shoulder_flexion")])
    assert np.allclose(found, np.degrees(flexions), atol=25.0)  # the upper arm hangs off the vertical
    assert np.abs(np.diff(found[1:])).max() < 45.0


NAMES = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
STANDING = {
    f"{side}_{name}": [out * (0.2 if name in NAMES[:3] else 0.1), down, 2.0]
    for side, out in (("right", -1.0), ("left", 1.0))
    for name, down in zip(NAMES, (-0.4, -0.1, 0.15, 0.1, 0.5, 0.9), strict=True)
}


def test_hanging_arms_have_no_angles() -> None:
    """Limbs straight down along the trunk, for any turn of the person; all names exist."""
    turn = np.array([[0.0, 0.6, 0.8], [0.0, -0.8, 0.6], [1.0, 0.0, 0.0]])
    found = angles_from_joints(tuple(STANDING), np.array([list(STANDING.values())]) @ turn.T)
    assert len(found) == 12
    assert np.abs(list(found.values())).max() < 1e-6


def test_joints_of_a_body_give_the_angles_of_its_pose() -> None:
    """Elbows and knees to the degree; shoulders and hips, whose upright is another, within ten."""
    model = human(1.8)
    bent = {f"{side}_{joint}_flexion": 0.9 for side in "rl" for joint in ("elbow", "hip", "knee")}
    raised = {"r_shoulder_flexion": 0.7, "l_shoulder_abduct": 0.5, "root_tz": 2.5, "root_ry": 0.4}
    pose = name_pose(model, bent | raised)[None]
    angles = angles_of(model, {})
    known = dict(zip(angles.names, np.degrees(angles.measure(pose)[0]), strict=True))
    found = angles_from_joints(model.joint_names, joint_positions(model, pose))
    assert len(found) == 12
    for name, values in found.items():
        near = 1.0 if "elbow" in name or "knee" in name else 10.0
        assert np.degrees(values[0]) == pytest.approx(known[name], abs=near), name


def test_what_is_not_known_is_left_out() -> None:
    """Angles of joints without a name; NaN where a joint is, or where two coincide."""
    names = ("right_shoulder", "right_elbow", "right_wrist")
    joints = np.array([[STANDING[name] for name in names]] * 3)
    joints[0, 2], joints[1, 2] = np.nan, joints[1, 1]
    found = angles_from_joints(names, joints)
    assert list(found) == ["right_elbow_flexion"]
    assert np.isnan(found["right_elbow_flexion"]).tolist() == [True, True, False]
