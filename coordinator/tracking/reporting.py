"""The estimate of a frame, with a status and the reason for doubt."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Mask
from gepf.common.frame import Frame, SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.colour.matching import in_image
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.cameras import CameraStates, faults_of
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN, Certainty, Estimate, Status, doubtful_joints_text
from gepf.coordinator.tracking.judgement import Judgement
from gepf.coordinator.tracking.state import FrameState, PersonState
from gepf.coordinator.tracking.track_state import (
    Absent,
    Found,
    Lost,
    Searching,
    Tracked,
    TrackedBefore,
    TrackState,
)


class Stopwatch:
    """Seconds by stage of one frame: the time that the coordinator works on it or waits for it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a `with` block to a stage."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


@dataclass(frozen=True, slots=True, eq=False)
class UpdatedPerson:
    """One person in a frame that has not been reported yet."""

    frame: Frame
    state: PersonState  # after the frame
    particle_count: int  # number of refined particles
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
    """All people in one frame, and the part of the state after it that belongs to no person."""

    people: Sequence[TrackedPerson]
    state: FrameState


class Doubt(NamedTuple):
    """Why a pose is in doubt, as text, and whether it is ambiguous."""

    why: str = ""
    is_ambiguous: bool = False


def report(updated: UpdatedPerson, cameras: CameraStates, settings: Settings) -> TrackedPerson:
    """The estimate of an updated frame, with the certainty of each joint and a status."""
    with updated.clock.stage("report"):
        start, track, judgement = updated.state.start, updated.state.track, updated.judgement
        limits, confirmed_s = settings.certainty, settings.track.camera_confirmed_s
        model, pose = start.model, start.pose
        followed = track if isinstance(track, TrackedBefore) else None
        poses, weights = np.empty((0, len(pose))), np.empty(0)
        if followed is not None:
            pose, poses = followed.belief.reported, followed.belief.poses[: limits.max_hypotheses]
            weights = followed.belief.weights[: limits.max_hypotheses]
            weights = weights / weights.sum()
        joints = joint_positions(model, pose[None])[0]
        certainty, doubt = unknown_certainty(len(joints)), Doubt()
        if judgement is not None and followed is not None:
            certainty = judgement.certainty
            doubt = doubt_of(followed, judgement, model.joint_names, settings)
        elif isinstance(track, Searching):
            doubt = Doubt(track.why)
        status = status_of(track, is_ambiguous=doubt.is_ambiguous)
    subject = None if judgement is None else judgement.subject
    keypoints = in_image(subject) if subject is not None and subject.has_keypoints else {}
    estimate = Estimate(
        frame=updated.frame.number,
        time_s=updated.frame.time_s,
        status=status,
        pose=pose[model.moves],
        joint_positions=joints,
        hypothesis_pose=poses[:, model.moves],
        hypothesis_weight=weights,
        residual=np.nan if followed is None else float(followed.belief.residual[0]),
        particles=updated.particle_count,
        why=doubt.why,
        stage_seconds=updated.clock.seconds,
        seen_by={} if judgement is None else judgement.seen_by,
        faults=faults_of(cameras, updated.frame.time_s, confirmed_s),
        keypoints=keypoints,
        certainty=unknown_certainty(len(joints)) if status in POSE_UNKNOWN else certainty,
    )
    return TrackedPerson(estimate, updated.state, subject)


def doubt_of(
    track: TrackedBefore, judgement: Judgement, joint_names: tuple[str, ...], settings: Settings
) -> Doubt:
    """The doubt: cameras disagree, front and back look alike, clothes differ, or joints may be wrong."""
    dispute = track.agreement.dispute(list(judgement.seen_by), settings.track.camera_confirmed_s)
    joints = explain_doubt(joint_names, judgement.certainty, judgement.doubted, settings.certainty.wrong_m)
    is_sure = track.is_facing_known(settings.colour) and not track.has_other_clothes(settings.colour)
    is_ambiguous = dispute or judgement.is_doubtful or not is_sure
    return Doubt(dispute or track.doubt(settings.colour) or joints, bool(is_ambiguous))


def status_of(track: TrackState, *, is_ambiguous: bool) -> Status:
    """The status of a frame.

    `absent`: nothing shows a body. `searching`: something may be the body, but where the body is remains
    unknown. `lost`: the pose does not explain the frame. `ambiguous`: a tracked pose is doubtful.
    """
    match track:
        case Searching(visibility="something") | Lost(visibility="body"):
            return "searching"
        case Absent() | Found() | Searching() | Lost(visibility="nothing"):
            return "absent"
        case Tracked(unexplained_s=0.0):
            return "ambiguous" if is_ambiguous else "tracked"
    return "lost"


def explain_doubt(names: tuple[str, ...], certainty: Certainty, doubted: Mask, wrong_m: float) -> str:
    """Text that names the doubted joints (J,), the most likely to be wrong first; empty if there are none."""
    order = np.argsort(-certainty.off_probability, kind="stable")
    listed = ", ".join(names[j].replace("_", " ") for j in order if doubted[j])
    return doubtful_joints_text(wrong_m, listed) if listed else ""
