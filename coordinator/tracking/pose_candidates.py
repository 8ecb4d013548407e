"""Candidates of a detection: refined poses and shapes; which are distinct, and which face the other way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, natural_angles
from gepf.common.refinement import Refined
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.colour.matching import ExpectedBody, keypoint_cost
from gepf.coordinator.filters.priors import log_rest_prior
from gepf.coordinator.tracking.judgement import Gate
from gepf.coordinator.tracking.observation import in_view
from gepf.coordinator.tracking.state import Start


@dataclass(frozen=True, slots=True, eq=False)
class PoseCandidates:
    """Refined candidates (N), the most likely first; at least one."""

    poses: Array  # (N, D), with shape coefficients if the shape of the body is not known
    log_posterior: Array  # (N,) log likelihood plus `log_prior`
    log_prior: Array  # (N,) log prior of pose and shape that the refinement does not count
    residual: Array  # (N,) metres
    joints: Array  # (N, J, 3) rig frame, metres

    @property
    def is_visible(self) -> bool:
        """Whether the frame shows any of them."""
        return bool(np.isfinite(self.log_posterior[0]))

    def take(self, indices: Indices) -> PoseCandidates:
        """The candidates with these indices, in this order."""
        return PoseCandidates(*(getattr(self, column.name)[indices] for column in fields(self)))

    def depth_log_likelihood(self, model: BodyModel, subject: SubjectFrame) -> Array:
        """The log likelihood (N,) from depth alone, without keypoints and the priors of the family."""
        costs = [keypoint_cost(ExpectedBody(model, pose), subject) for pose in self.poses]
        return np.asarray(self.log_posterior - self.log_prior + costs)

    def distinct(
        self, model: BodyModel, count: int, distinct_m: float, seen: Mask | None = None
    ) -> PoseCandidates:
        """Up to `count` distinct candidates, and the best that faces the other way, if none of them does.

        Only joints that are in view (`seen`, (N, J)) for at least one of the two candidates are compared.
        """
        kept = keep_distinct(self.joints, count, distinct_m, seen)
        turned = family_of(model).faces_away(model.joint_names, self.joints, self.joints[0])
        if not turned[kept].any():
            kept = np.sort(np.append(kept, np.flatnonzero(turned)[:1]))
        return self.take(kept)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A detection: the frame, refined candidates of the tracked body in it, and whether they pass gating."""

    subject: SubjectFrame
    start: Start
    candidates: PoseCandidates
    gate: Gate

    def is_elsewhere(self, joints: Array, wrong_m: float) -> bool:
        """Whether a joint in view is so far from its place in joints (J, 3) that one of the two is wrong."""
        detected = self.candidates.joints[0]
        seen = in_view(self.subject, np.stack([detected, joints])).any(axis=0)
        return bool(np.any(np.linalg.norm(detected - joints, axis=-1)[seen] > wrong_m))

    def faces_away(self, joints: Array) -> Mask:
        """Which candidates (N,) face opposite to joints (J, 3)."""
        start = self.start
        return start.family.faces_away(start.model.joint_names, self.candidates.joints, joints)

    def facing_is_ambiguous(self, joints: Array, log_likelihood: float, alike_nats: float) -> bool:
        """Whether a candidate that faces opposite to joints (J, 3) explains the depth about equally well.

        `log_likelihood` is that of the pose with these joints, also from depth alone.
        """
        return bool(np.any(self.depth_log_likelihood[self.faces_away(joints)] > log_likelihood - alike_nats))

    @property
    def depth_log_likelihood(self) -> Array:
        """The log likelihood (N,) of the candidates from depth alone."""
        return self.candidates.depth_log_likelihood(self.start.model, self.subject)


def candidates_of(
    model: BodyModel,
    refined: Refined,
    subject: SubjectFrame,
    settings: RefineSettings,
    *,
    knows_shape: bool = True,
) -> PoseCandidates:
    """The candidates made from the refined poses of a body, in the same order.

    Their log posterior includes the priors that the refinement does not count. The prior of shapes counts
    only until the shape is known.
    """
    after = natural_angles(model, refined.poses)
    family, joints = family_of(model), joint_positions(model, after)
    prior = family.log_pose_prior(model, settings, after) + log_rest_prior(model, settings, after)
    if model.shape_count and not knows_shape:
        seen = in_view(subject, joints)
        prior += family.log_shape_prior(model.joint_names, after[:, : model.shape_count], seen)
    return PoseCandidates(after, refined.log_likelihood + prior, prior, refined.residual, joints)


def ordered(parts: Sequence[PoseCandidates]) -> PoseCandidates:
    """All visible candidates, the most likely first; if none is visible, one with log posterior -inf."""
    columns = ([getattr(part, column.name) for part in parts] for column in fields(PoseCandidates))
    whole = PoseCandidates(*map(np.concatenate, columns))
    order = np.argsort(-whole.log_posterior, kind="stable")
    visible = max(1, int(np.isfinite(whole.log_posterior).sum()))
    return whole.take(order[:visible])


def keep_distinct(joints: Array, count: int, distinct_m: float, seen: Mask | None = None) -> Indices:
    """Indices of up to `count` bodies with joints (N, J, 3) whose mean distance exceeds `distinct_m`.

    The mean is over the joints that are in view (`seen`, (N, J)) for at least one of the two bodies; over all
    joints if `seen` is None.
    """
    kept = list[int]()
    for n, body in enumerate(joints):
        if len(kept) == count:
            break
        weights = np.ones((len(kept), joints.shape[1])) if seen is None else seen[kept] | seen[n]
        apart = np.linalg.norm(joints[kept] - body, axis=-1)
        if np.all(np.sum(apart * weights, axis=-1) > distinct_m * weights.sum(axis=-1)):
            kept.append(n)
    return np.array(kept, dtype=np.int64)
