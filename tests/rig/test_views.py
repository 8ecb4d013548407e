"""Several cameras: what each adds to a pose, in the kernel and in the tracker."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import Frame, SubjectFrame
from gepf.common.kinematics import joint_positions, retract
from gepf.common.kinematics.rotations import euler_angles, euler_matrix
from gepf.common.refinement import Particles, lower_triangular
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import coarsen, name_pose
from gepf.coordinator.settings import SceneSettings, preset
from gepf.coordinator.tracking.segmenter import ExpectedSurface, Segmenter
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import observe
from tests.support.people import SETTINGS, STANDING, known, subject_of
from tests.support.rigs import around, seen_from

RULES = msgspec.structs.replace(preset("default").refine, pose_deviation=0.0, noise_depth=0.015)
ASIDE = {"front": around(0.0), "side": around(80.0)}
POINTS = 2000


@cache
def body() -> BodyModel:
    """A person with few vertices."""
    return coarsen(human(1.82), 0.04)


@cache
def pose() -> Array:
    """A pose (D,) whose right arm, behind the trunk, only the second camera sees."""
    behind = {"r_shoulder_flexion": -0.6, "r_shoulder_abduct": 0.05, "r_elbow_flexion": 1.2, "root_ry": 1.2}
    return name_pose(body(), {**STANDING, **behind})


def both(places: dict[str, Array] | None = None) -> SubjectFrame:
    """The person as both cameras see them."""
    return subject_of(seen_from(body(), [pose()] * 2, places or ASIDE), POINTS)


def near(count: int = 4) -> Array:
    """Poses (count, D) near the true one."""
    rng = np.random.default_rng(0)
    spread = np.where(body().kinds == 0, 0.02, 0.08)
    drawn: Array = pose() + spread * rng.normal(size=(count, len(pose())))
    return drawn


def moved_by(placed: Array, poses: Array) -> Array:
    """Poses (N, D) of the root after a rigid transform (4, 4)."""
    after = poses.copy()
    after[:, :3] = poses[:, :3] @ placed[:3, :3].T + placed[:3, 3]
    for each in after:
        each[3:6] = euler_angles(placed[:3, :3] @ euler_matrix(each[3:6]), each[3:6])
    return after


def test_a_rig_may_have_any_frame() -> None:
    """Moved as a whole, the cameras and the body give the same likelihoods and the moved joints."""
    move = around(33.0)
    move[:3, 3] += [0.4, -0.2, 0.7]
    here = refine(body(), observe(both()), Particles(near(), RULES))
    away = {name: move @ placed for name, placed in ASIDE.items()}
    frame = seen_from(body(), [pose()] * 2, ASIDE)
    moved = Frame.of(*(replace(view, T_rig_camera=away[view.camera]) for view in frame.views))
    there = refine(body(), observe(subject_of(moved, POINTS)), Particles(moved_by(move, near()), RULES))
    np.testing.assert_allclose(there.log_likelihood, here.log_likelihood, rtol=1e-3)
    joints = joint_positions(body(), here.poses) @ move[:3, :3].T + move[:3, 3]
    np.testing.assert_allclose(joint_positions(body(), there.poses), joints, atol=1e-3)


def test_the_log_likelihood_is_the_mean_over_the_points_of_all_cameras() -> None:
    """Each camera's own, weighted with its number of points."""
    whole, still = both(), msgspec.structs.replace(RULES, icp_iterations=0)
    alone = [replace(whole, views=(view,)) for view in whole.views]
    assert len(alone) == 2
    points = np.array([len(view.picked) for view in whole.views])
    weights = points / points.sum()
    particles = Particles(near(), still)
    each = np.array([refine(body(), observe(view), particles).log_likelihood for view in alone])
    found = refine(body(), observe(whole), Particles(near(), still)).log_likelihood
    np.testing.assert_allclose(found, weights @ each, rtol=1e-9)


def test_a_second_camera_finds_the_arm_that_the_first_does_not_see() -> None:
    """Its joints are nearer to the truth, and its covariance is smaller."""
    arm = [body().dof(f"r_{name}") for name in ("shoulder_flexion", "elbow_flexion")]
    true, start = joint_positions(body(), pose()[None])[0], pose()[None].copy()
    start[0, arm] += 0.4
    many, errors, spreads = msgspec.structs.replace(RULES, icp_iterations=12), [], []
    for subject in (subject_of(seen_from(body(), [pose()], {"front": ASIDE["front"]}), POINTS), both()):
        found = refine(body(), observe(subject), Particles(start, many, covariance=True))
        wrist = body().joint_names.index("right_wrist")
        errors.append(np.linalg.norm(joint_positions(body(), found.poses)[0, wrist] - true[wrist]))
        assert found.covariance_roots is not None
        root = lower_triangular(found.covariance_roots, len(pose()))[0]
        spreads.append(np.sqrt(np.diag(root @ root.T))[arm])
    assert errors[1] < 0.06
    assert errors[0] > 2.0 * errors[1]
    assert np.all(spreads[1] < 0.7 * spreads[0])


@pytest.mark.parametrize("delay_s", [0.016, -0.016])
def test_a_camera_with_another_time_sees_the_body_where_it_is_then(delay_s: float) -> None:
    """With its velocity, the pose is that of the frame's time; without, it lies in between."""
    velocity = np.zeros((1, len(pose())))
    velocity[0, :3] = [1.5, 0.0, 0.5]
    then = retract(body(), pose()[None], delay_s * velocity)[0]
    frame = seen_from(body(), [pose(), then], ASIDE)
    front, side = frame.views
    late = replace(side, time_s=frame.time_s + delay_s)
    observed = observe(subject_of(Frame.of(front, late), POINTS))
    off = []
    for known_velocity in (velocity[0], None):
        found = refine(body(), observed, Particles(pose()[None], RULES, velocity=known_velocity))
        off.append(np.linalg.norm(found.poses[0, :3] - pose()[:3]))
    assert off[0] < 0.003
    assert off[1] > 0.006


def test_people_in_several_images_are_as_many_as_there_are() -> None:
    """One person in two images is one candidate; somebody whom only one camera shows is another."""
    anywhere = [ExpectedSurface()]
    lone = Segmenter(POINTS, SceneSettings()).segment(seen_from(body(), [pose()] * 2, ASIDE), anywhere)
    (candidate,) = lone.candidates
    assert {view.image.camera for view in candidate.subject.views} == set(ASIDE)
    far = pose().copy()
    far[0] += 0.9
    seen = Segmenter(POINTS, SceneSettings()).segment(seen_from(body(), [pose(), far], ASIDE), anywhere)
    assert sorted(len(each.subject.views) for each in seen.candidates) == [1, 1]


def test_a_person_whom_one_camera_no_longer_sees_is_kept_by_the_other() -> None:
    """Within 5 cm from frame to frame, found by both, then seen by the second alone, then by the first."""
    model = human(1.82)
    standing = name_pose(model, STANDING)
    frame = seen_from(model, [standing] * 2, ASIDE)
    shows = ("both", "both", "side", "side", "front")
    true, tracker = joint_positions(model, standing[None])[0], Tracker(DirectRefiner(), SETTINGS, known())
    for number, which in enumerate(shows):
        (tracked,) = tracker.track(shown_by(frame, which, number)).people
        estimate = tracked.estimate
        assert estimate.status in ("tracked", "ambiguous")
        assert set(estimate.seen_by) == (set(ASIDE) if which == "both" else {which})
        assert np.linalg.norm(estimate.joint_positions - true, axis=1).max() < 0.08


def shown_by(frame: Frame, which: str, number: int) -> Frame:
    """The frame at a later number, with the depth of one camera only, or of both."""
    now = [replace(view, number=number, time_s=number / 30.0) for view in frame.views]
    return Frame.of(
        *(
            view if which in ("both", view.camera) else replace(view, depth=np.zeros_like(view.depth))
            for view in now
        )
    )
