"""How sure the tracker is of each joint: what the frame shows of it, and what speaks against it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.camera import Intrinsics, project
from common.frame import EMPTY, HIDDEN, SUBJECT, DepthFrame, SubjectFrame
from common.kinematics import pose_vertices
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.certainty.assessment import built_in, conclude, recall
from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.certainty.evidence import CLUES, Sighted, weigh_evidence
from coordinator.tracking.certainty.regions import regions_of
from coordinator.tracking.observation import isolate
from coordinator.tracking.reporting import explain_doubt, judge
from coordinator.tracking.track_management import TrackManagement
from tests.support.people import CAMERA, STANDING, frame_of

Array = NDArray[np.float64]

FINE = Intrinsics(1280, 960, 1160.0, 1160.0, 639.5, 479.5)
BEFORE_THE_BODY = {**STANDING, "r_shoulder_flexion": 1.2, "r_elbow_flexion": 1.3, "r_shoulder_twisting": 0.8}
SIDEWAYS = {**STANDING, "root_ry": 1.4}


@cache
def body() -> BodyModel:
    """A person with the usual degrees of freedom."""
    whole = human(1.75)
    return activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))


def pose_of(values: dict[str, float]) -> Array:
    """A pose (D,) by name."""
    return name_pose(body(), values)


@cache
def seen_as(posture: str) -> SubjectFrame:
    """A frame that shows the body so."""
    pose = pose_of({"standing": STANDING, "folded": BEFORE_THE_BODY, "sideways": SIDEWAYS}[posture])
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(body(), pose[None])[0], body().triangles)
    subject = isolate(frame_of(0, depth), 4_000)
    assert subject is not None
    return subject


def evidence_of(values: dict[str, float], subject: SubjectFrame) -> Array:
    """Evidence (J, K) about a pose with no other hypothesis, held for a while."""
    pose = pose_of(values)
    return weigh_evidence(body(), pose, pose[None], np.ones(1), Sighted(subject, pose, 1.0 / 30.0, 1.0))


def certainty_of(values: dict[str, float], subject: SubjectFrame) -> Certainty:
    """What follows from it."""
    evidence = evidence_of(values, subject)
    return conclude(evidence, built_in().judge(evidence))


def shown_by_rendering(pose: Array) -> Array:
    """Share (J,) of each region's surface facing the camera that OpenGL's z-buffer shows."""
    vertices, triangles = pose_vertices(body(), pose[None])[0], body().triangles
    with DepthRenderer(FINE) as renderer:
        depth = renderer.depth(vertices, triangles)
    a, b, c = vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]
    normals = np.zeros_like(vertices)
    for corner in triangles.T:
        np.add.at(normals, corner, np.cross(b - a, c - a))
    facing = np.maximum(0.0, -np.sum(normals * vertices, axis=1) / np.linalg.norm(vertices, axis=1))
    columns, rows = np.rint(project(vertices, FINE)).astype(int).T
    behind = np.where(depth > 0.0, depth, np.float32(np.inf))[rows, columns]
    open_to_view = vertices[:, 2] <= behind + 0.02
    regions = regions_of(body())
    shares = []
    for first, last in zip(regions.starts[:-1], regions.starts[1:], strict=True):
        mine = regions.vertices[first:last]
        weight = regions.weights[first:last] * facing[mine]
        shares.append(weight[open_to_view[mine]].sum() / weight.sum())
    return np.array(shares)


@pytest.mark.parametrize(
    ("posture", "values"), [("standing", STANDING), ("folded", BEFORE_THE_BODY), ("sideways", SIDEWAYS)]
)
def test_what_is_seen_of_a_joint_is_what_a_rendering_shows(posture: str, values: dict[str, float]) -> None:
    """Joint for joint, against OpenGL's z-buffer; some are open to view, sideways some are hidden."""
    seen = certainty_of(values, seen_as(posture)).seen
    rendered = shown_by_rendering(pose_of(values))
    np.testing.assert_allclose(seen, rendered, atol=0.12)
    assert np.abs(seen - rendered).mean() < 0.04
    assert seen.max() > 0.95
    if posture == "sideways":
        assert seen.min() < 0.3


def test_a_table_hides_what_is_behind_it() -> None:
    """Legs behind something nearer are not seen, and nothing speaks against them; without it, all does."""
    subject = seen_as("standing")
    kinds = np.where(subject.frame.depth > 0, np.uint8(SUBJECT), np.uint8(EMPTY))
    knee = body().joint_names.index("right_knee")
    below = slice(kinds.shape[0] // 2, None)
    depth = subject.frame.depth.copy()
    depth[below], kinds[below] = 0, HIDDEN
    behind_a_table = replace(subject, frame=replace(subject.frame, depth=depth), kinds=kinds)
    behind_a_table = replace(behind_a_table, picked=np.flatnonzero(depth).astype(np.uint32)[::8])
    gone = replace(behind_a_table, kinds=np.where(kinds == HIDDEN, np.uint8(EMPTY), kinds))
    hidden, missing = evidence_of(STANDING, behind_a_table)[knee], evidence_of(STANDING, gone)[knee]
    shown, violated = CLUES.index("shown"), CLUES.index("violated")
    assert hidden[shown] < 0.05
    assert hidden[violated] < 0.05
    assert missing[violated] > 0.9


def test_a_limb_that_is_elsewhere_is_flagged() -> None:
    """The true pose raises no flag; with an arm 70 degrees off its wrist is the likeliest to be off."""
    right = certainty_of(STANDING, seen_as("standing"))
    wrong = certainty_of({**STANDING, "r_shoulder_abduct": 1.4}, seen_as("standing"))
    wrist, other = (body().joint_names.index(f"{side}_wrist") for side in ("right", "left"))
    assert (right.off_probability < 0.07).all()
    assert wrong.off_probability[wrist] > 0.14
    assert np.argmax(wrong.off_probability) in (wrist, body().joint_names.index("right_elbow"))
    assert wrong.off_probability[other] < 0.07
    assert wrong.deviation[wrist] > 2.0 * right.deviation[wrist]


def test_rivals_make_a_joint_unsure() -> None:
    """Two ways to hold an arm, of equal weight: its wrist is in doubt, and more so than with one of 1 %."""
    pose, other = pose_of(STANDING), pose_of({**STANDING, "r_elbow_flexion": 1.5})
    sighted = Sighted(seen_as("standing"), pose, 1.0 / 30.0, 1.0)
    wrist = body().joint_names.index("right_wrist")

    def certainty(weights: list[float]) -> Certainty:
        evidence = weigh_evidence(body(), pose, np.stack([pose, other]), np.array(weights), sighted)
        return conclude(evidence, built_in().judge(evidence))

    even, odd = certainty([0.5, 0.5]), certainty([0.99, 0.01])
    assert even.off_probability[wrist] > odd.off_probability[wrist]
    assert even.deviation[wrist] > odd.deviation[wrist] > 0.0
    np.testing.assert_array_equal(even.seen, odd.seen)


def test_a_lone_particle_is_not_sure_because_it_is_alone() -> None:
    """That one hypothesis is left of many says something; that one particle was drawn does not."""
    pose = pose_of(STANDING)
    sighted = Sighted(seen_as("standing"), pose, 1.0 / 30.0, 1.0)
    agreed, alone = (
        conclude(evidence, built_in().judge(evidence, lone=each.lone))
        for each in (sighted, replace(sighted, lone=True))
        for evidence in [weigh_evidence(body(), pose, pose[None], np.ones(1), each)]
    )
    assert np.all(alone.off_probability > 2.0 * agreed.off_probability)
    assert np.all(alone.deviation > agreed.deviation)


def test_what_was_known_fades() -> None:
    """A verdict that stays is itself; after no time it is the old one, after a second the new one."""
    new, old = np.full((3, 2), 1.0), np.full((3, 2), -2.0)
    np.testing.assert_array_equal(recall(new, None, 0.1), new)
    np.testing.assert_allclose(recall(old, old, 0.05), old)
    np.testing.assert_allclose(recall(new, old, 0.0), old)
    np.testing.assert_allclose(recall(new, old, 1.0), new, atol=1e-3)
    assert -2.0 < recall(new, old, 0.1)[0, 0] < 1.0


def test_evidence_that_is_beyond_all_measure_counts_as_its_limit() -> None:
    """Infinite and missing clues leave probabilities between 0 and 1, and deviations finite."""
    for value in (np.inf, -np.inf, np.nan, 1e300):
        evidence = np.full((2, len(CLUES)), value)
        found = conclude(evidence, built_in().judge(evidence))
        assert np.all((found.off_probability > 0.0) & (found.off_probability < 1.0))
        assert np.all(np.isfinite(found.deviation))


def test_a_frame_without_the_body_in_it_still_says_something() -> None:
    """A pose far from all that is seen: nothing is shown of it, and no number breaks."""
    depth = np.zeros((40, 40), dtype=np.uint16)
    depth[10:30, 10:30] = 2_000
    frame = DepthFrame(0, 0.0, depth, 1000.0, Intrinsics(40, 40, 60.0, 60.0, 19.5, 19.5))
    subject = isolate(frame, 100)
    assert subject is not None
    found = certainty_of({**STANDING, "root_tz": -3.0}, subject)
    assert np.isfinite(found.off_probability).all()
    assert found.seen.max() == 0.0


@pytest.mark.parametrize(
    ("off", "word", "why"),
    [
        ([0.0, 0.0, 0.0], "tracked", ""),
        ([0.0, 0.35, 0.0], "ambiguous", "may be more than 15 cm off: left knee"),
        ([0.4, 0.35, 0.0], "ambiguous", "may be more than 15 cm off: head, left knee"),
        ([0.6, 0.55, 0.0], "lost", "may be more than 15 cm off: head, left knee"),
    ],
)
def test_status_follows_from_the_joints(off: list[float], word: str, why: str) -> None:
    """One joint in doubt makes a frame ambiguous, most of them lost; it says which, the likeliest first."""
    certainty = Certainty(np.ones(3), np.array(off), np.full(3, 0.05))
    assert judge(TrackManagement(), np.ones(1), np.zeros((1, 3, 3)), np.zeros((3, 3)), certainty) == word
    assert explain_doubt(("head", "left_knee", "left_hip"), certainty) == why
