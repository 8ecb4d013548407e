"""Certainty of each joint: its visibility, and evidence against it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS
from gepf.common.camera import Intrinsics, project
from gepf.common.frame import HIDDEN, SUBJECT, SubjectFrame
from gepf.common.kinematics import joint_positions, keypoint_positions, pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.colour.matching import ExpectedBody
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.tracking.certainty import Features, judge, regions_of, shown_in_colour
from gepf.coordinator.tracking.estimate import Certainty
from gepf.coordinator.tracking.judgement import doubted_joints
from gepf.coordinator.tracking.reporting import explain_doubt
from tests.support.bodies import person
from tests.support.features import features_in
from tests.support.people import SETTINGS, STANDING, alone, frame_of, rendered, subject_of

BODY = person()
FINE = Intrinsics(1280, 960, 1160.0, 1160.0, 639.5, 479.5)
POSTURES = {
    "standing": STANDING,
    "folded": {**STANDING, "r_shoulder_flexion": 1.2, "r_elbow_flexion": 1.3, "r_shoulder_twisting": 0.8},
    "sideways": {**STANDING, "root_ry": 1.4},
}


@cache
def seen_as(posture: str) -> SubjectFrame:
    """A frame that shows the body so."""
    (depth,) = rendered(BODY, name_pose(BODY, POSTURES[posture])[None])
    return subject_of(frame_of(0, depth), 4_000)


def features_of(values: dict[str, float], subject: SubjectFrame, *others: dict[str, float]) -> Features:
    """Features (J,) of a pose, held for a while, and other hypotheses of the same weight."""
    poses = np.array([name_pose(BODY, each) for each in (values, *others)])
    return features_in(BODY, poses, subject, SETTINGS.refine)


def certainty_of(values: dict[str, float], subject: SubjectFrame, *others: dict[str, float]) -> Certainty:
    """The certainty from these features."""
    return judge(features_of(values, subject, *others), CertaintySettings())


def shown_by_rendering(pose: Array) -> Array:
    """Share (J,) of each joint's surface facing the camera that OpenGL's z-buffer shows."""
    vertices, triangles = pose_vertices(BODY, pose[None])[0], BODY.triangles
    (depth,) = rendered(BODY, pose[None], FINE)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    middles = (a + b + c) / 3.0
    facing = np.maximum(0.0, -np.sum(np.cross(b - a, c - a) * middles, axis=1) / middles[:, 2])
    columns, rows = np.rint(project(middles, FINE)).astype(int).T
    behind = np.where(depth > 0.0, depth, np.inf)[rows, columns]
    area = regions_of(BODY, CertaintySettings().region_m).T * facing
    shares: Array = area @ (middles[:, 2] <= behind + 0.02) / area.sum(axis=1)
    return shares


@pytest.mark.parametrize("posture", POSTURES)
def test_what_is_seen_of_a_joint_is_what_a_rendering_shows(posture: str) -> None:
    """Joint for joint, against OpenGL's z-buffer; what lies close behind another part counts as seen."""
    seen = certainty_of(POSTURES[posture], seen_as(posture)).seen
    drawn = shown_by_rendering(name_pose(BODY, POSTURES[posture]))
    np.testing.assert_allclose(seen, drawn, atol=0.35)
    assert np.abs(seen - drawn).mean() < 0.081
    assert np.all(seen > drawn - 0.05)
    assert seen.max() > 0.95
    if posture == "sideways":
        assert seen.min() < 0.05


def test_a_table_hides_what_is_behind_it() -> None:
    """Legs behind something nearer are not seen, and may be anywhere."""
    subject = seen_as("standing")
    depth, knee = subject.largest.image.depth.copy(), BODY.joint_names.index("right_knee")
    depth[depth.shape[0] // 2 :] = 0
    kinds = np.where(depth > 0, np.uint8(SUBJECT), np.uint8(HIDDEN))
    picked = np.flatnonzero(depth).astype(np.uint32)[::8]
    view = subject.largest
    behind = alone(replace(view, image=replace(view.image, depth=depth), labels=kinds, picked=picked))
    whole, hidden = certainty_of(STANDING, subject), certainty_of(STANDING, behind)
    assert hidden.seen[knee] < 0.05
    assert hidden.off_probability[knee] > 10.0 * whole.off_probability[knee]
    assert hidden.deviation[knee] > 3.0 * whole.deviation[knee]


def test_a_limb_that_is_elsewhere_is_flagged() -> None:
    """The true pose raises no flag; with an arm 70 degrees off its wrist is the likeliest to be off."""
    right = certainty_of(STANDING, seen_as("standing"))
    wrong = certainty_of({**STANDING, "r_shoulder_abduct": 1.4}, seen_as("standing"))
    wrist, other = (BODY.joint_names.index(f"{side}_wrist") for side in ("right", "left"))
    assert (right.off_probability < 0.04).all()
    assert wrong.off_probability[wrist] > 2.0 * 0.04
    assert np.argmax(wrong.off_probability) in (wrist, BODY.joint_names.index("right_elbow"))
    assert wrong.off_probability[other] < 0.04
    assert wrong.deviation[wrist] > 2.0 * right.deviation[wrist]


def test_a_limb_that_is_elsewhere_leaves_points_that_nothing_explains() -> None:
    """An arm on the trunk fits the points around it; those beside the trunk are within its reach."""
    on_trunk = {**STANDING, "r_shoulder_flexion": 0.5, "r_elbow_flexion": 1.4, "r_shoulder_twisting": -0.9}
    right, wrong = (features_of(values, seen_as("standing")) for values in (STANDING, on_trunk))
    elbow, ankle = (BODY.joint_names.index(f"right_{name}") for name in ("elbow", "ankle"))
    assert np.allclose(right.unexplained, right.unexplained.min())  # nothing is unexplained
    assert wrong.unexplained[elbow] > right.unexplained[elbow] + 2.0
    assert wrong.unexplained[ankle] < right.unexplained[ankle] + 0.5


def test_a_joint_that_colour_shows_is_more_certain() -> None:
    """By how precise its keypoint is, and only if it is there; one that colour shows elsewhere is not."""
    body, pose = human(1.82), name_pose(human(1.82), STANDING)
    subject = subject_of(frame_of(0, rendered(body, pose[None])[0]), 500)
    places = project(keypoint_positions(body, pose[None])[0], subject.largest.image.intrinsics)
    keypoints = np.column_stack([places, np.full(len(places), 0.1)]).astype(np.float32)
    knee, ankle, wrist = ([*KEYPOINTS].index(name) for name in ("left_knee", "left_ankle", "left_wrist"))
    keypoints[ankle, 2] *= 0.25
    keypoints[wrist, 0] += 60.0
    posed, coloured = ExpectedBody(body, pose), alone(replace(subject.largest, keypoints=keypoints))
    assert not shown_in_colour(posed, subject, 3.0).any()
    shown = shown_in_colour(posed, coloured, 3.0)
    named = dict(zip(body.joint_names, shown.tolist(), strict=True))
    assert [named[KEYPOINTS[k]] for k in (knee, ankle, wrist)] == pytest.approx([1.0, 0.25, 0.0])
    assert named["pelvis"] == 0.0  # not a keypoint
    features = features_in(body, pose[None], subject, SETTINGS.refine)
    plain, beside = (judge(features, CertaintySettings(), None, each) for each in (None, shown))
    ratio = beside.off_probability / plain.off_probability
    assert ratio[body.joint_names.index("left_knee")] < 0.5
    assert (ratio[shown == 0.0] == 1.0).all()
    np.testing.assert_array_equal(beside.deviation, plain.deviation)


def test_rivals_make_a_joint_unsure() -> None:
    """With another way to hold an arm, as likely, its wrist is in more doubt than with none."""
    other, wrist = {**STANDING, "r_elbow_flexion": 1.5}, BODY.joint_names.index("right_wrist")
    unbounded = CertaintySettings(max_nats=100.0)  # without noise there is no other doubt
    alone, rivals = (
        judge(features_of(STANDING, seen_as("standing"), *others), unbounded) for others in ((), (other,))
    )
    assert rivals.off_probability[wrist] > alone.off_probability[wrist]
    assert rivals.deviation[wrist] > alone.deviation[wrist] > 0.0
    np.testing.assert_array_equal(rivals.seen, alone.seen)


def test_points_that_the_body_does_not_explain_are_doubts_of_the_joints_beside_them() -> None:
    """A skirt's width of points around the knees: they are told for the knees, not for the head."""
    subject = seen_as("standing")
    depth, row = subject.largest.image.depth.copy(), knee_row(subject)
    shin = depth[row - 10 : row + 10]
    columns = np.flatnonzero(shin.any(axis=0))
    reach = slice(max(0, columns[0] - 20), columns[-1] + 21)
    shin[:, reach] = np.where(shin[:, reach] > 0, shin[:, reach], np.median(shin[shin > 0]))
    wide = subject_of(frame_of(0, depth / 1000.0, subject.largest.image.intrinsics), 4_000)
    plain, skirt = features_of(STANDING, subject), features_of(STANDING, wide)
    knees = np.isin(BODY.joint_names, ("right_knee", "left_knee"))
    assert (skirt.unexplained[knees] > plain.unexplained[knees] + 1.0).all()
    head = BODY.joint_names.index("head")
    assert skirt.unexplained[head] == pytest.approx(plain.unexplained[head], abs=0.1)


def knee_row(subject: SubjectFrame) -> int:
    """The row of the crop in which the right knee of the standing body is."""
    joints = joint_positions(BODY, name_pose(BODY, STANDING)[None])[0]
    (_, row), *_ = project(joints[[BODY.joint_names.index("right_knee")]], subject.largest.image.intrinsics)
    return round(float(row))


def test_a_body_at_rest_is_neither_bent_nor_folded_nor_crowded() -> None:
    """A bent elbow bends itself and the hand alone, and folds the body."""
    rest = features_of({"root_tz": 2.5}, seen_as("standing"))
    bent = features_of({"root_tz": 2.5, "r_elbow_flexion": 1.0}, seen_as("standing"))
    for feature in (rest.bend, rest.folding, rest.crowding):
        np.testing.assert_allclose(feature, 0.0, atol=1e-9)
    arm = np.isin(BODY.joint_names, ("right_elbow", "right_wrist"))
    np.testing.assert_allclose(bent.bend, arm * 1.0)
    assert bent.folding[0] > 0.01


def test_a_frame_without_the_body_in_it_still_says_something() -> None:
    """A pose far from all that is seen: nothing is shown of it, and no number breaks."""
    plate = np.pad(np.full((20, 20), 2.0), 10)
    frame = frame_of(0, plate, Intrinsics(40, 40, 60.0, 60.0, 19.5, 19.5))
    found = certainty_of({**STANDING, "root_tz": -3.0}, subject_of(frame, 100))
    assert np.isfinite(found.off_probability).all()
    assert found.seen.max() == 0.0


@pytest.mark.parametrize(
    ("off", "faulty", "new", "why"),
    [
        ([0.0, 0.0, 0.0], False, False, ""),
        ([0.0, 0.35, 0.0], False, False, "left knee"),
        ([0.4, 0.35, 0.0], False, False, "head, left knee"),
        ([0.1, 0.0, 0.1], False, False, ""),
        ([0.1, 0.0, 0.1], True, False, "left hip"),  # it is hidden
        ([0.11, 0.0, 0.1], False, True, "head, left hip"),
    ],
)
def test_doubtful_joints_are_named(off: list[float], faulty: bool, new: bool, why: str) -> None:
    """Joints in doubt are listed, the most likely to be wrong first."""
    certainty = Certainty(np.array([1.0, 1.0, 0.2]), np.array(off), np.full(3, 0.05))
    doubted = doubted_joints(certainty, CertaintySettings(), is_new=new, has_fault=faulty)
    doubt = explain_doubt(("head", "left_knee", "left_hip"), certainty, doubted, 0.15)
    assert doubt == (f"may be more than 15 cm off: {why}" if why else "")
