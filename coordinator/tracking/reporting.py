"""The estimate of a frame: pose, joints, hypotheses, certainty of each joint, and a status."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import joint_positions, retract
from gepf.coordinator.bodies.angles import is_person
from gepf.coordinator.colour.finder import in_image
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.filters.motion import precisions
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import faults_of
from gepf.coordinator.tracking.certainty.certainty import (
    FIT,
    FLAGGED,
    OFF,
    SUSPECTED,
    Certainty,
    unknown_certainty,
)
from gepf.coordinator.tracking.certainty.features import FrameContext, measure_features, movable_joints
from gepf.coordinator.tracking.certainty.surface import seen_shares
from gepf.coordinator.tracking.estimate import MAX_HYPOTHESES, POSE_UNKNOWN, Estimate, Status
from gepf.coordinator.tracking.field_of_view import in_view
from gepf.coordinator.tracking.state import TrackerState
from gepf.coordinator.tracking.track_management import CHECK_INTERVAL_FRAMES, TrackManagement

HIDDEN_SHARE = 0.5  # a joint that is seen less than this is hidden
RIVAL_WEIGHT = 0.5  # least weight of a rival, relative to the most likely hypothesis

INFORMATION = 44.0
"""Of the points of a known body; fitted to rendered robots and objects with a Kinect's noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Updated:
    """A frame whose belief is updated, before it is reported."""

    frame: DepthFrame
    state: TrackerState  # after the frame
    belief: Belief | None  # the one in the state
    status: Status | None  # None: it follows from the belief
    particles: int  # refined ones
    context: FrameContext | None  # None if nothing was refined
    clock: Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One person in one frame: the estimate, the tracker's state after it, and the person's crop."""

    estimate: Estimate
    state: TrackerState
    subject: SubjectFrame | None = None


def report(updated: Updated) -> Tracked:
    """The estimate of an updated frame, with the certainty of each joint and a status."""
    with updated.clock.stage("report"):
        start, management = updated.state.start, updated.state.checkpoint.management
        model, belief = start.model, updated.belief
        certainty, disputed = unknown_certainty(len(model.joint_names)), ""
        in_sight = np.ones(len(model.joint_names), dtype=np.bool_)
        cameras = updated.state.checkpoint.cameras
        faulty = any(each.fault for each in cameras.values())
        pose, poses, weights = start.pose, np.empty((0, len(start.pose))), np.empty(0)
        if belief is not None:
            pose, poses = belief.reported, belief.poses[:MAX_HYPOTHESES]
            weights = belief.weights[:MAX_HYPOTHESES]
            weights = weights / weights.sum()
        joints = joint_positions(model, np.concatenate([pose[None], poses]))
        seen = dict[str, Array]()
        if updated.context is not None:
            context = updated.context
            in_sight = in_view(context.subject, joints[0])
            seen_by = seen_shares(model, pose, context.subject, context.stretch) * in_sight
            features = measure_features(model, pose, joints, weights, context, management.residual, seen_by)
            certainty = FIT.judge(features, in_sight)
            names = [name for name, moves in zip(model.dof_names, model.moves, strict=True) if moves]
            if belief is not None and belief.posterior.size and not is_person(names):
                certainty = replace(certainty, deviation=known_deviations(model, pose, belief.posterior))
            certainty = replace(certainty, off_probability=certainty.off_probability * movable_joints(model))
            views = [each.frame.camera for each in context.subject.views]
            seen = dict(zip(views, seen_by, strict=True))
            disputed = updated.state.checkpoint.agreement.dispute(views)
        new = len(cameras) > 1 and management.tracked < CHECK_INTERVAL_FRAMES
        least = least_probability(certainty, faulty=faulty, new=new)
        doubt = explain_doubt(model.joint_names, certainty, np.where(in_sight, least, 1.0))
        doubted = bool(disputed or doubt)
        status = updated.status or status_of(
            management, weights, joints[1:, in_sight], joints[0, in_sight], doubted=doubted
        )
    estimate = Estimate(
        frame=updated.frame.number,
        time_s=updated.frame.time_s,
        status=status,
        pose=pose[model.moves],
        joint_positions=joints[0],
        hypothesis_pose=poses[:, model.moves],
        hypothesis_weight=weights,
        residual=np.nan if belief is None else float(belief.residual[0]),
        particles=updated.particles,
        why=disputed or management.reason or doubt,
        stage_seconds=updated.clock.seconds,
        seen_by=seen,
        faults=faults_of(cameras, updated.frame.time_s),
        keypoints={} if updated.context is None else in_image(updated.context.subject),
        certainty=unknown_certainty(len(joints[0])) if status in POSE_UNKNOWN else certainty,
    )
    subject = None if updated.context is None else updated.context.subject
    return Tracked(estimate, updated.state, subject)


def status_of(
    management: TrackManagement, weights: Array, joints: Array, reported: Array, *, doubted: bool
) -> Status:
    """Status of a frame that shows something, from weights (M,) and joints (M, J, 3), most likely first.

    Joints are those in view. `reported` (J, 3) are the reported ones; they may differ from those of the most
    likely hypothesis.

    `searching`: the body may be anywhere. `lost`: the pose does not explain the frame. `ambiguous`: it is
    `doubted`, an equally likely hypothesis has a joint elsewhere, or front and back look alike.
    """
    if management.is_lost:
        return "searching"
    if management.unexplained:
        return "lost"
    apart = np.linalg.norm(joints[weights > RIVAL_WEIGHT * weights[0]] - reported, axis=-1)
    doubted = doubted or management.ambiguous_facing or bool(np.any(apart > OFF))
    return "ambiguous" if doubted else "tracked"


def least_probability(certainty: Certainty, *, faulty: bool, new: bool) -> Array:
    """Probabilities (J,) of being wrong above which joints are in doubt.

    While a camera is `faulty`, hidden joints are doubted sooner, as the others may not show them. All are if
    the body of several cameras is `new`: detected a few frames before, or a camera has come back.
    """
    return np.where(new | (faulty & (certainty.seen < HIDDEN_SHARE)), FLAGGED, SUSPECTED)


def explain_doubt(names: tuple[str, ...], certainty: Certainty, least: Array) -> str:
    """Text that names joints (J,) with more than these probabilities to be wrong, the most probable first."""
    probability = certainty.off_probability
    doubted = [j for j in np.argsort(-probability, kind="stable") if probability[j] > least[j]]
    listed = ", ".join(names[j].replace("_", " ") for j in doubted)
    return f"may be more than {100 * OFF:.0f} cm off: {listed}" if doubted else ""


def known_deviations(model: BodyModel, pose: Array, covariance: Array) -> Array:
    """Expected distance (J,) from a robot's or object's true joints, one standard deviation, metres.

    `covariance` (D, D) of its pose (D,) is that of the refinement, which counts all points as one with an
    error of 1 cm, because the shape of people is not known. Those of a known body are worth more, the weak
    prior is not.
    """
    weak = np.diag(precisions(model)[0])
    scaled = np.linalg.inv(weak + INFORMATION * (np.linalg.inv(covariance) - weak))
    step = 1e-5  # of differences, metres or radians
    steps = step * np.concatenate([np.eye(len(pose)), -np.eye(len(pose))])
    ahead, behind = np.split(joint_positions(model, retract(model, np.tile(pose, (len(steps), 1)), steps)), 2)
    jacobian = (ahead - behind) / (2.0 * step)
    squares: Array = np.einsum("djx,de,ejx->j", jacobian, scaled, jacobian)
    return np.sqrt(squares)
