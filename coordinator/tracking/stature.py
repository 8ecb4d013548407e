"""A person's stature, from the distance between head and soles in the first frames that show both.

Closest points determine stature badly: few of them are on head and feet, and the pose can compensate for a
wrong size, on tiptoe or slightly bent. So the length is measured in the depth image; the model only says
where head and feet are. For a standing person the median over a window of frames repeats within 1 cm. After
that the stature stays constant, unless a later window contradicts it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import pixels_at, points_of
from gepf.common.frame import EMPTY, HIDDEN, SubjectFrame
from gepf.common.kinematics import joint_positions

INTERVAL_S = 0.095  # shortest time between measured frames: errors of successive frames are correlated
WINDOW_FRAMES = 15  # medians of two successive windows differ by less than 1 cm (subjects 1 and 2)
LEAST_CHANGE_SHARE = 0.005  # of stature; a smaller change does not justify a new body
CONTRADICTION_SHARE = 0.03  # of stature; least change by a later window: three times a window's error
DEVIATION_SHARES = (0.08, 0.02)  # of stature, before and after a measurement: known people's errors
UPRIGHT_SHARE = 0.97  # of the length at rest; a body that is bent more does not show its stature
AXIS_RADIUS_M = 0.14  # around the body's axis: the width of a head
ADULT_M, ADULT_DEVIATION_M = 1.69, 0.10  # mean and deviation of the statures of adults
END_M = 0.06  # most by which a body that is too large exceeds the points at a joint, and largest gap


@dataclass(frozen=True, slots=True)
class StatureEstimate:
    """Statures (m) measured in the present window of frames; settled after the first full window."""

    statures: tuple[float, ...] = ()
    settled: bool = False
    time_s: float = -np.inf  # time of the last measured frame

    def add(self, stature: float, time_s: float) -> Self:
        """Add the stature (m) of another frame; a full window is followed by a new one."""
        if len(self.statures) < WINDOW_FRAMES:
            return replace(self, statures=(*self.statures, stature), time_s=time_s)
        return replace(self, statures=(stature,), settled=True, time_s=time_s)

    def revise(self, stature: float) -> float:
        """The stature (m) to continue with, given the present one."""
        if not self.statures:
            return stature
        measured = float(np.median(self.statures))
        due = len(self.statures) == WINDOW_FRAMES or not self.settled
        least = CONTRADICTION_SHARE if self.settled else LEAST_CHANGE_SHARE
        return measured if due and abs(measured / stature - 1.0) > least else stature


def log_prior(statures: Array) -> Array:
    """Log density of statures (N,), metres, up to a constant: children are as likely as the mean adult."""
    above = np.maximum(0.0, (statures - ADULT_M) / ADULT_DEVIATION_M)
    return np.asarray(-0.5 * above**2)


def measure_stature(model: BodyModel, pose: Array, straight_m: float, subject: SubjectFrame) -> float | None:
    """Stature in metres of a person in pose (D,); None if the frame does not show it.

    Each nearly straight leg gives one: `straight_m`, the distance from head to ankle of the model standing
    straight, plus the lengths by which the person extends beyond these joints.
    """
    places = subject.frame.to_camera(joint_positions(model, pose[None])[0])
    joints = dict(zip(model.joint_names, places, strict=True))
    head, statures = joints["head"], list[float]()
    raised = any(
        (joints[f"{side}_wrist"] - joints[f"{side}_shoulder"]) @ (head - joints["pelvis"]) > 0.0
        for side in ("left", "right")
    )
    if raised:  # a raised hand may be mistaken for the head
        return None
    depth = subject.frame.metres().astype(np.float64)
    points = points_of(depth, subject.frame.intrinsics, depth > 0.0)
    for foot in (joints["left_ankle"], joints["right_ankle"]):
        between = float(np.linalg.norm(head - foot))
        if between > UPRIGHT_SHARE * straight_m:
            up = (head - foot) / between
            ends = _find_end(subject, points, head, up) + _find_end(subject, points, foot, -up)
            statures.append(straight_m + ends)
    return float(np.nanmean(statures)) if np.isfinite(statures).any() else None


def head_to_ankle(model: BodyModel) -> float:
    """Distance in metres from the head to the farther ankle of a body that stands straight."""
    joints = joint_positions(model, np.zeros((1, len(model.dof_names))))[0]
    head, *ankles = (joints[model.joint_names.index(n)] for n in ("head", "left_ankle", "right_ankle"))
    return max(float(np.linalg.norm(head - ankle)) for ankle in ankles)


def _find_end(subject: SubjectFrame, points: Array, joint: Array, outwards: Array) -> float:
    """Length (m) of the person, shown by points (P, 3), beyond a joint (3,); NaN if the end is hidden.

    Pixels at the edge of a person often have no depth, and near a floor it is unclear what they show. So the
    person ends in the middle between the last point and the first pixel that shows something else.
    """
    offset = points - joint
    along = offset @ outwards
    aside = np.einsum("pi,pi->p", offset, offset) - along * along
    near = np.flatnonzero(aside < AXIS_RADIUS_M**2)
    if not len(near):
        return float("nan")
    last = near[along[near].argmax()]
    end = float(along[last])
    if end < -END_M:  # the points end far from the joint: something hides it
        return float("nan")
    pixel = float(points[last, 2] / subject.frame.intrinsics.fx)
    beyond = np.arange(pixel, END_M, pixel)
    labels = _labels(subject, points[last] + beyond[:, None] * outwards)
    shown = np.flatnonzero((labels == EMPTY) | (labels == HIDDEN))
    if len(shown) and labels[shown[0]] == HIDDEN:
        return float("nan")
    return end + 0.5 * float(beyond[shown[0]] if len(shown) else pixel)


def _labels(subject: SubjectFrame, points: Array) -> Array:
    """Labels (P,) of the pixels of points (P, 3); HIDDEN outside the image."""
    v, u, inside = pixels_at(points, subject.frame.intrinsics)
    left, top, right, bottom = subject.view
    labels = np.where((left <= u) & (u < right) & (top <= v) & (v < bottom), EMPTY, HIDDEN)
    if subject.kinds is not None:
        labels[inside] = subject.kinds[v[inside], u[inside]]
    return labels
