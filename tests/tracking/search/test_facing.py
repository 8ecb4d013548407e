"""Front and back of who is found again: decided by the frame, and doubted where it does not decide."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from common.kinematics import joint_positions, pose_vertices
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.known import Known
from coordinator.tracking.search.facing import TOLD_APART, across, both_ways, looks_alike, turned_round
from coordinator.tracking.search.recall import recall
from coordinator.tracking.search.stages import Standing
from coordinator.tracking.search.verdict import Verdict
from coordinator.tracking.search.watch import AGAIN, CHECKS, LOOKS_ALIKE, Watch
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.status import is_settled, judge
from gepf.direct import DirectRefiner
from tests.support.people import CAMERA, SETTINGS, STANDING, empty, frame_of, known

Array = NDArray[np.float64]

NOISE = 0.03  # metres
MODEL = human(1.82)
NAMES = MODEL.joint_names
FRONT, BACK, SIDE = 0.0, np.pi, 0.5 * np.pi  # of the root's turn


@cache
def poses(*turns: float) -> Array:
    """A person whose left and right are alike, turned so."""
    return np.array([name_pose(MODEL, {**STANDING, "root_ry": turn}) for turn in turns])


@pytest.mark.parametrize("turn", [FRONT, BACK])
def test_who_comes_back_faces_the_way_that_is_seen(turn: float) -> None:
    """After frames that show nothing, as before or turned round: behind noise, arms hanging alike."""
    shown, rng = poses(FRONT, turn), np.random.default_rng(0)
    truth = joint_positions(MODEL, shown)
    with DepthRenderer(CAMERA) as renderer:
        first, then = (renderer.depth(v, MODEL.triangles) for v in pose_vertices(MODEL, shown))
    pictures = [(first, truth[0])] * 2 + [(then, truth[1])] * 3
    tracker, number = Tracker(DirectRefiner(), SETTINGS, known(), Known(STANDING)), 0
    for n, (picture, joints) in enumerate(pictures):
        if n == 2:
            for _ in range(3):
                assert tracker.track(empty(number)).status == "absent"
                number += 1
        noisy = np.where(picture > 0.0, picture + NOISE * rng.standard_normal(picture.shape), 0.0)
        estimate = tracker.track(frame_of(number, noisy))
        number += 1
        assert estimate.status in ("tracked", "ambiguous")
        assert across(NAMES, estimate.joint_positions) @ across(NAMES, joints) > 0.0
        assert np.linalg.norm(estimate.joint_positions - joints, axis=-1).mean() < 0.05


def standing(log_likelihood: list[float], *turns: float) -> Standing:
    """Candidates turned so, with these log likelihoods."""
    found = poses(*turns)
    sizes, residual = np.zeros(len(turns), dtype=np.int64), np.zeros(len(turns))
    return Standing(found, sizes, np.array(log_likelihood), residual, joint_positions(MODEL, found))


def test_who_faces_away_is_turned_round() -> None:
    """Half a turn is, less than a quarter is not; of a body without sides nobody knows."""
    joints = joint_positions(MODEL, poses(FRONT, BACK, 0.3))
    assert turned_round(NAMES, joints, joints[0]).tolist() == [False, True, False]
    assert not turned_round(("base", "tip"), joints[:, :2], joints[0, :2]).any()


def test_the_other_way_round_is_tried_to_the_end() -> None:
    """It is kept though others are likelier, and only once."""
    found = standing([-1.0, -2.0, -3.0, -40.0, -50.0], FRONT, 0.3, -0.3, BACK, BACK + 0.3)
    assert both_ways(found, NAMES, 2, 0.01).log_likelihood.tolist() == [-1.0, -2.0, -40.0]
    assert both_ways(found, NAMES, 4, 0.01).log_likelihood.tolist() == [-1.0, -2.0, -3.0, -40.0]


@pytest.mark.parametrize(("less", "alike"), [(0.5 * TOLD_APART, True), (1.5 * TOLD_APART, False)])
def test_both_ways_about_as_likely_look_alike(less: float, alike: bool) -> None:
    """Whichever of them is believed; who is turned but a little is no rival."""
    found = standing([-3.0, -3.1, -3.0 - less], FRONT, 0.3, BACK)
    assert looks_alike(NAMES, found, found.joints[0], -3.0) is alike
    assert looks_alike(NAMES, found, found.joints[2], -3.0 - less)


def test_what_looks_alike_is_ambiguous() -> None:
    """In words, too; it is searched again before long, and no size is measured meanwhile."""
    sure = Certainty(*np.zeros((3, 3)))
    doubted = Watch(tracked=CHECKS[-1] + 1).searched(alike=True)
    weights, joints = np.ones(1), np.zeros((1, 3, 3))
    assert judge(doubted, weights, joints, joints[0], sure) == "ambiguous"
    assert doubted.reason == LOOKS_ALIKE
    assert not is_settled(doubted, weights, joints)
    for _ in range(AGAIN):
        doubted = doubted.followed(Verdict(0.5), anew=False)
        assert doubted.alike
        if doubted.checks:
            break
    assert doubted.checks
    assert judge(doubted.searched(alike=False), weights, joints, joints[0], sure) == "tracked"


def test_a_frame_without_anybody_is_not_said_to_look_alike() -> None:
    """Whoever was in doubt before is gone."""
    gone = Watch().searched(alike=True).saw_nobody()
    assert not gone.alike
    assert gone.reason == ""


def test_both_ways_come_the_likeliest_first() -> None:
    """Also where who faces the other way was left out for being near a likelier one."""
    found = standing([-1.0, -2.0, -2.1, -30.0], FRONT, 0.25 * np.pi, 0.5 * np.pi + 0.05, -0.7)
    kept = both_ways(found, NAMES, 3, 0.2).log_likelihood
    assert kept.tolist() == sorted(kept, reverse=True)


def test_a_posture_is_recalled_where_the_body_is_now() -> None:
    """As it was and turned by quarters, within a hand's breadth of where it is."""
    there = poses(SIDE)
    there[:, :3] += (0.4, 0.1, 0.6)
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(MODEL, there)[0], MODEL.triangles).astype(np.float64)
    v, u = np.nonzero(depth)
    z = depth[v, u]
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=-1)
    found = joint_positions(MODEL, recall(MODEL, poses(FRONT)[0], points).poses)
    apart = np.linalg.norm(found - joint_positions(MODEL, there)[0], axis=-1).mean(axis=-1)
    assert apart.min() < 0.1
