"""The estimate of a frame, with a status and the reason for doubt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame, SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.colour.matching import in_image
from gepf.coordinator.settings import CertaintySettings, Settings
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import CameraStates, faults_of
from gepf.coordinator.tracking.certainty import FrameContext, unknown_certainty
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN, Certainty, Estimate, Status, list_joints
from gepf.coordinator.tracking.judgement import Judgement
from gepf.coordinator.tracking.state import FrameState, PersonState
from gepf.coordinator.tracking.track_state import (
    Absent,
    Followed,
    Found,
    Lost,
    Searching,
    Tracked,
    TrackState,
)


@dataclass(frozen=True, slots=True, eq=False)
class Updated:
    """One person in a frame, before it is reported."""

    frame: Frame
    state: PersonState  # after the frame
    particles: int  # refined ones
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
    """All people in one frame, and what is known beside them after it."""

    people: Sequence[TrackedPerson]
    state: FrameState


def report(updated: Updated, cameras: CameraStates, settings: Settings) -> TrackedPerson:
    """The estimate of an updated frame, with the certainty of each joint and a status."""
    with updated.clock.stage("report"):
        start, track, context = updated.state.start, updated.state.track, updated.context
        limits, confirmed_s = settings.certainty, settings.track.camera_confirmed_s
        followed = track if isinstance(track, Followed) else None
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
            limit = least_probability(certainty, limits, faulty=faulty, new=new)
            disputed = followed.agreement.dispute(views, confirmed_s)
            in_doubt = np.where(judgement.in_sight, limit, 1.0)
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
        case Searching(sight="something") | Lost(sight="body"):
            return "searching"
        case Absent() | Found() | Searching() | Lost(sight="nothing"):
            return "absent"
        case Tracked(unexplained_s=0.0):
            return "ambiguous" if is_ambiguous else "tracked"
    return "lost"


def least_probability(certainty: Certainty, settings: CertaintySettings, *, faulty: bool, new: bool) -> Array:
    """Probabilities (J,) of being wrong above which joints are in doubt.

    A body is doubted sooner while it is `new`: detected a few frames before, or a camera has come back. While
    a camera is `faulty`, hidden joints are, as the others may not show them.
    """
    sooner = new | (faulty & (certainty.seen < settings.hidden_share))
    return np.where(sooner, settings.flagged_probability, settings.ambiguous_probability)


def explain_doubt(names: tuple[str, ...], certainty: Certainty, least: Array, wrong_m: float) -> str:
    """Text that names joints (J,) with more than these probabilities to be wrong, the most probable first."""
    probability = certainty.off_probability
    doubted = [j for j in np.argsort(-probability, kind="stable") if probability[j] > least[j]]
    listed = ", ".join(names[j].replace("_", " ") for j in doubted)
    return list_joints(wrong_m, listed) if doubted else ""
