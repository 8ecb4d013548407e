"""Judges a pose in a frame: whether it is accepted, how certain its joints are, and which are in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, retract
from gepf.common.settings import SOFT_NOISE_RATIO, RefineSettings
from gepf.coordinator.colour.matching import ExpectedBody
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.filters.priors import weak_precisions
from gepf.coordinator.settings import CertaintySettings, GatingSettings, Settings
from gepf.coordinator.tracking.certainty import (
    FrameContext,
    judge,
    measure_features,
    movable_joints,
    seen_shares,
    shown_in_colour,
)
from gepf.coordinator.tracking.estimate import Certainty
from gepf.coordinator.tracking.observation import in_view


@dataclass(frozen=True, slots=True)
class Gate:
    """The normalised residual of a pose, accepted if at most 1. `why` is the main reason against it."""

    normalised_residual: float
    why: str = ""

    @property
    def passes(self) -> bool:
        """Whether the pose is accepted."""
        return self.normalised_residual <= 1.0

    def rejected_for(self, why: str) -> Self:
        """The gate of a pose that is ruled out for another reason; unchanged if `why` is empty."""
        return type(self)(np.inf, self.why or why) if why else self


def gate_pose(
    log_likelihood: float, residual: float, settings: RefineSettings, limits: GatingSettings
) -> Gate:
    """The gate of a pose with this log likelihood and mean residual (metres), at the camera's noise."""
    misfit = 0.0
    # with far more noise in depth than across, the cost cannot tell surface in empty space apart from noise
    if settings.noise_depth <= SOFT_NOISE_RATIO * settings.noise_lateral:
        cost = np.sqrt(max(0.0, -2.0 * log_likelihood)) * settings.likelihood_scale
        misfit = float(cost / np.hypot(limits.max_misfit_m, settings.noise_lateral))
    normalised = max(float(residual) / max_distance_m(settings, limits), misfit)
    if not normalised <= 1.0:  # also if it is NaN
        return Gate(normalised if normalised > 1.0 else np.inf, "the body does not fit the observed points")
    return Gate(normalised)


def max_distance_m(settings: RefineSettings, limits: GatingSettings) -> float:
    """The largest mean distance of observed points from a body that is accepted, metres."""
    return limits.max_residual_m + settings.noise_depth


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """How certain the joints (J,) of the reported pose in a frame are."""

    subject: SubjectFrame  # the crop in which the pose is judged
    certainty: Certainty
    seen_by: dict[str, Array]  # by camera: the share (J,) of the surface around each joint that it sees
    doubted: Mask  # (J,) joints in view that are too likely to be wrong
    has_rival: bool  # whether a comparably likely hypothesis places a joint in view elsewhere

    @property
    def is_doubtful(self) -> bool:
        """Whether a joint in view may be wrong."""
        return self.has_rival or bool(self.doubted.any())


def judge_pose(
    model: BodyModel,
    belief: Belief,
    normalised_residual: float,
    context: FrameContext,
    all_settings: Settings,
    *,
    is_exact: bool,
    is_new: bool,
    has_fault: bool,
) -> Judgement:
    """Judge a belief in a frame; `is_exact` is that of the family; for the others, see `doubted_joints`."""
    pose, settings = belief.reported, all_settings.certainty
    poses, weights = belief.poses[: settings.max_hypotheses], belief.weights[: settings.max_hypotheses]
    joints = joint_positions(model, np.concatenate([pose[None], poses]))
    joints_in_view = in_view(context.subject, joints[0])
    seen_by = seen_shares(model, pose, context.subject, context.stretch, settings) * joints_in_view
    features = measure_features(model, pose, joints, weights, context, normalised_residual, seen_by, settings)
    max_deviations = all_settings.colour.same_person_deviations
    shown = shown_in_colour(ExpectedBody(model, pose), context.subject, max_deviations)
    certainty = judge(features, settings, joints_in_view, shown)
    if belief.posterior.size and is_exact:
        deviation = deviations_of_exact_body(model, pose, belief.posterior, settings.information)
        certainty = replace(certainty, deviation=deviation)
    certainty = replace(certainty, off_probability=certainty.off_probability * movable_joints(model))
    rivals = has_rival(weights, joints[1:, joints_in_view], joints[0, joints_in_view], settings)
    doubted = joints_in_view & doubted_joints(certainty, settings, is_new=is_new, has_fault=has_fault)
    shares = {view.image.camera: seen for view, seen in zip(context.subject.views, seen_by, strict=True)}
    return Judgement(context.subject, certainty, shares, doubted, rivals)


def doubted_joints(
    certainty: Certainty, settings: CertaintySettings, *, is_new: bool, has_fault: bool
) -> Mask:
    """The joints (J,) that are too likely to be wrong.

    Joints are doubted sooner while the body is new, that is, shortly after its detection, or after a camera
    has come back. While a camera has a fault, hidden joints are also doubted sooner, because the remaining
    cameras may not see them.
    """
    sooner = is_new | (has_fault & (certainty.seen < settings.hidden_share))
    threshold = np.where(sooner, settings.flagged_probability, settings.ambiguous_probability)
    return np.asarray(certainty.off_probability > threshold)


def has_rival(weights: Array, joints: Array, reported: Array, settings: CertaintySettings) -> bool:
    """Whether a comparably likely hypothesis places a joint in view elsewhere.

    The hypotheses have weights (M,) and joints (M, J, 3), and are sorted most likely first. `reported`
    (J, 3) may differ from the most likely one.
    """
    apart = np.linalg.norm(joints[weights > settings.rival_share * weights[0]] - reported, axis=-1)
    return bool(np.any(apart > settings.wrong_m))


def deviations_of_exact_body(model: BodyModel, pose: Array, covariance: Array, information: float) -> Array:
    """One standard deviation (J,) of the error of each joint of a robot or object, metres.

    The `covariance` (D, D) of the pose (D,) is from the refinement, which treats all points together as one
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
