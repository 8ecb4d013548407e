"""A limb hidden by the body is reported as uncertain, and found as soon as it is visible again."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.scene.noise import SensorNoise, assume_noise
from gepf.coordinator.settings import CertaintySettings, preset
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.scenes import ARM_DOFS, arm
from gepf.coordinator.tracking.certainty import judge
from gepf.coordinator.tracking.estimate import Certainty
from tests.support.bodies import person
from tests.support.features import features_in
from tests.support.people import (
    SETTINGS,
    STANDING,
    Shown,
    changed,
    frame_of,
    rendered,
    show,
    shown,
    subject_of,
    tracker,
)

BACK = {**STANDING, "root_ry": np.pi}
FOLDED = {**BACK, "r_shoulder_abduct": -0.1, "r_shoulder_flexion": 0.6, "r_elbow_flexion": 2.4}
"""Seen from behind, the right forearm before the chest."""

HELD_UP = {
    **BACK, "r_shoulder_abduct": 0.0, "r_shoulder_flexion": 1.4, "r_shoulder_twisting": 0.6,
    "r_elbow_flexion": 0.6,
}  # fmt: skip
MANY = msgspec.structs.replace(SETTINGS, filter=msgspec.structs.replace(SETTINGS.filter, particles=20))


def shown_in(*poses: dict[str, float]) -> Shown:
    """The person in these poses, with the joints that are tracked."""
    return show(person(1.82), np.array([name_pose(person(1.82), pose) for pose in poses]))


def test_a_hidden_arm_is_not_said_to_be_known() -> None:
    """A hidden arm may be anywhere behind the body: it is flagged. It is found when it is visible again."""
    out = {**BACK, "r_shoulder_abduct": 1.0, "r_elbow_flexion": 0.5}
    frames, joints = shown_in(*[FOLDED] * 8, out, out, out)
    follower = tracker(MANY, FOLDED)
    estimates = [follower.track(frame) for frame in frames]
    wrist = follower.model.joint_names.index("right_wrist")
    for estimate in estimates[3:8]:
        assert estimate.certainty is not None
        assert estimate.certainty.off_probability[wrist] > 0.04
    assert np.linalg.norm(estimates[-1].joint_positions[wrist] - joints[-1, wrist]) < 0.1


def test_a_hidden_arm_does_not_fall_to_rest() -> None:
    """A forearm held up before the chest, seen from behind with noise: it does not move in any frame."""
    (still,), (true,) = shown_in(HELD_UP)
    picture = still.views[0].depth / 1000.0
    noise = 0.01 * np.random.default_rng(0).standard_normal((15, *picture.shape))
    follower = tracker(MANY, HELD_UP)
    wrist = follower.model.joint_names.index("right_wrist")
    for n, off in enumerate(noise):
        estimate = follower.track(frame_of(n, np.where(picture > 0.0, picture + off, 0.0)))
        assert np.linalg.norm(estimate.joint_positions[wrist] - true[wrist]) < 0.08


KNEES = 180  # row of the picture at which the standing person's are, about
OUTSIDE = ("right_ankle", "left_ankle")
INSIDE = ("head", "right_elbow", "right_wrist", "right_hip", "left_hip")


def followed(*, cropped: bool) -> Certainty:
    """The certainty in the last frame, whole or cut at the knees, of a person whose start is known."""
    following = tracker()
    for frame in shown("standing").frames:
        (view,) = frame.views
        rows = KNEES if cropped else view.intrinsics.height
        camera = view.intrinsics.crop(0, 0, view.intrinsics.width, rows)
        estimate = following.track(changed(frame, depth=view.depth[:rows].copy(), intrinsics=camera))
    assert estimate.certainty is not None
    return estimate.certainty


def test_joints_outside_the_picture_are_much_less_sure() -> None:
    """They are not seen, ten times as likely off as those in the picture, by more. None in it is flagged."""
    names = tracker().model.joint_names
    outside, inside = ([names.index(name) for name in group] for group in (OUTSIDE, INSIDE))
    whole, cropped = followed(cropped=False), followed(cropped=True)
    assert (cropped.seen[outside] < 0.05).all()
    assert cropped.off_probability[outside].min() > 10.0 * cropped.off_probability[inside].max()
    assert cropped.deviation[outside].min() > 2.0 * cropped.deviation[inside].max()
    assert (cropped.off_probability[inside] < 0.04).all()
    assert (whole.off_probability[outside] < 0.04).all()
    assert (whole.seen[outside] > 0.5).all()


NOISE = SensorNoise(depth=0.15, lateral=0.01)
FRAME = 30
LOST = np.array([0.459, -0.61, 0.801, 2.46])  # where `--method gradient` has the arm then, before the trunk


@cache
def scene() -> tuple[BodyModel, Array, SubjectFrame]:
    """The arm's model, its true pose (4,) in a frame, and the noisy frame."""
    shot = arm()
    (depth,) = rendered(shot.model, shot.poses[FRAME : FRAME + 1], shot.camera)
    noisy = add_noise(depth, shot.camera, NOISE, np.random.default_rng(0))
    subject = subject_of(frame_of(0, noisy, shot.camera, 10_000.0), 10_000)
    model = activate(shot.model, ARM_DOFS, shot.poses[FRAME])
    return model, shot.poses[FRAME][[shot.model.dof(name) for name in ARM_DOFS]], subject


def certainty_of(pose: Array) -> Certainty:
    """How sure the joints are of a lone particle's pose (4,)."""
    model, _, subject = scene()
    settings = assume_noise(preset("default").refine, NOISE)
    return judge(
        features_in(model, pose[None], subject, settings, NOISE.lateral / NOISE.depth), CertaintySettings()
    )


def test_an_arm_that_is_lost_before_the_trunk_is_flagged() -> None:
    """The lost arm is flagged; neither the true pose nor fixed joints are."""
    model, true, _ = scene()
    moved = [model.joint_names.index(f"right_{part}") for part in ("shoulder", "elbow", "wrist")]
    held = np.setdiff1d(np.arange(len(model.joint_names)), moved)
    lost, found = certainty_of(LOST), certainty_of(true)
    assert lost.off_probability[moved[-1]] > 0.04
    assert lost.deviation[moved[-1]] > 2.0 * found.deviation[moved[-1]]
    assert (found.off_probability < 0.04).all()
    assert (lost.off_probability[held] < 0.04).all()
