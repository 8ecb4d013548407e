"""The estimate of a frame: pose, joints, hypotheses, certainty of each joint, and a status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import Frame, SubjectFrame
from gepf.common.kinematics import joint_positions, retract
from gepf.coordinator.colour.matching import ExpectedBody, in_image
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.filters.priors import weak_precisions
from gepf.coordinator.settings import CertaintySettings, Settings
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import CameraStates, faults_of
from gepf.coordinator.tracking.certainty import (
    Features,
    FrameContext,
    judge,
    measure_features,
    movable_joints,
    seen_shares,
    shown_in_colour,
    unknown_certainty,
)
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN, Certainty, Estimate, Status, doubtful_joints_text
from gepf.coordinator.tracking.field_of_view import in_view
from gepf.coordinator.tracking.state import FrameState, PersonState, Start
from gepf.coordinator.tracking.track_state import (
    Absent,
    Initialised,
    Lost,
    OnceTracked,
    Searching,
    Tracked,
    TrackState,
)


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """How certain the joints (J,) of the most likely pose in a frame are."""

    certainty: Certainty
    seen_by: Array  # (C, J) share of the surface around each joint that each camera sees
    joints_in_view: Mask  # (J,) joints that are in view and not hidden by something else
    has_rival: bool  # whether a comparably likely hypothesis places a joint in view elsewhere
    is_doubtful: bool  # whether a joint in view may be wrong


def judge_pose(
    start: Start, belief: Belief, residual: float, context: FrameContext, all_settings: Settings
) -> Judgement:
    """Judge a belief that has this normalised residual in a frame."""
    model, pose, settings = start.model, belief.reported, all_settings.certainty
    poses, weights = belief.poses[: settings.max_hypotheses], belief.weights[: settings.max_hypotheses]
    joints = joint_positions(model, np.concatenate([pose[None], poses]))
    joints_in_view = in_view(context.subject, joints[0])
    seen_by = seen_shares(model, pose, context.subject, context.stretch, settings) * joints_in_view
    features = measure_features(model, pose, joints, weights, context, residual, seen_by, settings)
    farthest = all_settings.colour.same_person_deviations
    shown = shown_in_colour(ExpectedBody(model, pose), context.subject, farthest)
    certainty = certainty_of(start, belief, features, joints_in_view, shown, settings)
    rivals = has_rival(weights, joints[1:, joints_in_view], joints[0, joints_in_view], settings)
    likely = bool(np.any(certainty.off_probability[joints_in_view] > settings.ambiguous_probability))
    return Judgement(certainty, seen_by, joints_in_view, rivals, rivals or likely)


@dataclass(frozen=True, slots=True, eq=False)
class Updated:
    """One person in a frame, before it is reported."""

    frame: Frame
    state: PersonState  # after the frame
    particles: int  # number of refined particles
    context: FrameContext | None  # None if nothing was refined
    judgement: Judgement | None  # of the pose; None if nothing was refined
    clock: Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPerson:
    """One person in one frame: the estimate, the state after it, and the person's crop."""

    estimate: Estimate
    state: PersonState
    subject: SubjectFrame | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """All people in one frame, and the state after it that does not belong to a person."""

    people: Sequence[TrackedPerson]
    state: FrameState


def report(updated: Updated, cameras: CameraStates, settings: Settings) -> TrackedPerson:
    """The estimate of an updated frame, with the certainty of each joint and a status."""
    with updated.clock.stage("report"):
        start, track, context = updated.state.start, updated.state.track, updated.context
        limits, confirmed_s = settings.certainty, settings.track.camera_confirmed_s
        followed = track if isinstance(track, OnceTracked) else None
        model = start.model
        pose, poses, weights = start.pose, np.empty((0, len(start.pose))), np.empty(0)
        if followed is not None:
            pose, poses = followed.belief.reported, followed.belief.poses[: limits.max_hypotheses]
            weights = followed.belief.weights[: limits.max_hypotheses]
            weights = weights / weights.sum()
        joints = joint_positions(model, pose[None])[0]
        certainty, seen, why, is_ambiguous = unknown_certainty(len(joints)), dict[str, Array](), "", False
        judgement = updated.judgement
        if context is not None and judgement is not None and followed is not None:
            certainty = judgement.certainty
            views = [view.image.camera for view in context.subject.views]
            seen = dict(zip(views, judgement.seen_by, strict=True))
            faulty = any(state.fault for state in cameras.values())
            new = followed.is_new(settings.track)
            thresholds = doubt_thresholds(certainty, limits, faulty=faulty, new=new)
            disputed = followed.agreement.dispute(views, confirmed_s)
            in_doubt = np.where(judgement.joints_in_view, thresholds, 1.0)
            doubt = explain_doubt(model.joint_names, certainty, in_doubt, limits.wrong_m)
            why = disputed or followed.doubt(settings.colour) or doubt
            unsure = not followed.knows_facing(settings.colour)
            is_ambiguous = bool(disputed or doubt or unsure or judgement.has_rival)
        elif isinstance(track, Searching):
            why = track.why
        status = status_of(track, is_ambiguous=is_ambiguous)
    estimate = Estimate(
        frame=updated.frame.number,
        time_s=updated.frame.time_s,
        status=status,
        pose=pose[model.moves],
        joint_positions=joints,
        hypothesis_pose=poses[:, model.moves],
        hypothesis_weight=weights,
        residual=np.nan if followed is None else float(followed.belief.residual[0]),
        particles=updated.particles,
        why=why,
        stage_seconds=updated.clock.seconds,
        seen_by=seen,
        faults=faults_of(cameras, updated.frame.time_s, confirmed_s),
        keypoints={} if context is None else in_image(context.subject),
        certainty=unknown_certainty(len(joints)) if status in POSE_UNKNOWN else certainty,
    )
    return TrackedPerson(estimate, updated.state, None if context is None else context.subject)


def status_of(track: TrackState, *, is_ambiguous: bool) -> Status:
    """The status of a frame.

    `absent`: nothing shows a body. `searching`: something does, but not where it is. `lost`: the pose does
    not explain the frame. `ambiguous`: a tracked pose is doubtful.
    """
    match track:
        case Searching(visibility="something") | Lost(visibility="body"):
            return "searching"
        case Absent() | Initialised() | Searching() | Lost(visibility="nothing"):
            return "absent"
        case Tracked(unexplained_s=0.0):
            return "ambiguous" if is_ambiguous else "tracked"
    return "lost"


def has_rival(weights: Array, joints: Array, reported: Array, settings: CertaintySettings) -> bool:
    """Whether a comparably likely hypothesis places a joint in view elsewhere.

    Of hypotheses with weights (M,) and joints (M, J, 3), the most likely first. `reported` (J, 3) may differ
    from the most likely hypothesis.
    """
    apart = np.linalg.norm(joints[weights > settings.rival_share * weights[0]] - reported, axis=-1)
    return bool(np.any(apart > settings.wrong_m))


def certainty_of(
    start: Start,
    belief: Belief,
    features: Features,
    joints_in_view: Mask,
    shown: Array,
    settings: CertaintySettings,
) -> Certainty:
    """The certainty of each joint of the reported pose.

    `joints_in_view` (J,): joints in view; `shown` (J,): how well colour confirms them.
    """
    certainty = judge(features, settings, joints_in_view, shown)
    if belief.posterior.size and start.family.is_exact:
        deviation = known_deviations(start.model, belief.reported, belief.posterior, settings.information)
        certainty = replace(certainty, deviation=deviation)
    return replace(certainty, off_probability=certainty.off_probability * movable_joints(start.model))


def doubt_thresholds(certainty: Certainty, settings: CertaintySettings, *, faulty: bool, new: bool) -> Array:
    """Probabilities (J,) of being wrong above which joints are in doubt.

    A body is doubted sooner while it is `new`: detected a few frames earlier, or a camera has come back.
    While a camera is `faulty`, hidden joints are also doubted sooner, because the remaining cameras may not
    see them.
    """
    sooner = new | (faulty & (certainty.seen < settings.hidden_share))
    return np.where(sooner, settings.flagged_probability, settings.ambiguous_probability)


def explain_doubt(names: tuple[str, ...], certainty: Certainty, thresholds: Array, wrong_m: float) -> str:
    """Text that names joints (J,) with more than these probabilities to be wrong, the most probable first."""
    probability = certainty.off_probability
    doubted = [j for j in np.argsort(-probability, kind="stable") if probability[j] > thresholds[j]]
    listed = ", ".join(names[j].replace("_", " ") for j in doubted)
    return doubtful_joints_text(wrong_m, listed) if doubted else ""


def known_deviations(model: BodyModel, pose: Array, covariance: Array, information: float) -> Array:
    """Expected distance (J,) from a robot's or object's true joints, one standard deviation, metres.

    `covariance` (D, D) of its pose (D,) is that of the refinement, which treats all points together as one
    observation with an error of 1 cm, because people's shape is not known exactly. For a known body the
    points carry more information, so their part of the precision is multiplied by `information`; the weak
    prior is not.
    """
    weak = np.diag(weak_precisions(model))
    scaled = np.linalg.inv(weak + information * (np.linalg.inv(covariance) - weak))
    step = 1e-5  # of differences, metres or radians
    steps = step * np.concatenate([np.eye(len(pose)), -np.eye(len(pose))])
    ahead, behind = np.split(joint_positions(model, retract(model, np.tile(pose, (len(steps), 1)), steps)), 2)
    jacobian = (ahead - behind) / (2.0 * step)
    squares: Array = np.einsum("djx,de,ejx->j", jacobian, scaled, jacobian)
    return np.sqrt(squares)
