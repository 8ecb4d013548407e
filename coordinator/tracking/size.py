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

from common.arrays import Array
from common.body import BodyModel
from common.camera import back_project
from common.frame import HIDDEN, SubjectFrame
from common.kinematics import joint_positions

INTERVAL_S = 0.095  # shortest time between measured frames: errors of successive frames are correlated
WINDOW_FRAMES = 15  # medians of two successive windows differ by less than 1 cm (subjects 1 and 2)
LEAST_CHANGE_SHARE = 0.005  # of stature; a smaller change does not justify a new body
CONTRADICTION_SHARE = 0.03  # of stature; least change by a later window: three times a window's error
DEVIATION_SHARES = (
    0.08,
    0.02,
)  # of stature, before and after a measurement: errors of people of known stature
UPRIGHT_SHARE = 0.97  # of the length at rest; a body that is bent more does not show its stature
SEARCH_RADIUS_M = 0.3  # around head and ankle, for the end of the body
AXIS_RADIUS_M = 0.14  # around the body's axis: the width of a head
HIDDEN_END_M = 0.06  # a body that is too large may exceed the points by this much at a joint
STRAY_AREA_M2 = 2.5e-4  # of outliers beyond an end


@dataclass(frozen=True, slots=True)
class SizeEstimate:
    """Statures (m) measured in the present window of frames; settled after the first full window."""

    statures: tuple[float, ...] = ()
    settled: bool = False
    time_s: float = -np.inf  # time of the last measured frame

    @property
    def deviation_share(self) -> float:
        """Standard deviation of the stature, as a share of it; large until a frame shows it."""
        return DEVIATION_SHARES[bool(self.statures)]

    def is_due(self, time_s: float) -> bool:
        """Whether a frame at this time should be measured."""
        return not 0.0 <= time_s - self.time_s < INTERVAL_S

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


def measure_stature(model: BodyModel, pose: Array, straight_m: float, subject: SubjectFrame) -> float | None:
    """Stature in metres of a person in pose (D,); None if the frame does not show it.

    If the person leans or bends slightly, the length is scaled up by the ratio of the head-to-ankle distances
    of the straight model and the posed model. The outermost pixels are missing, so the stature is about 1 %
    too small; with a correction for that the joints are worse (subjects 1 and 2).

    Args:
        model: The tracked body.
        pose: Its pose in the frame.
        straight_m: Distance from head to ankle of this body standing straight.
        subject: The person's pixels.
    """
    places = subject.frame.to_camera(joint_positions(model, pose[None])[0])
    joints = dict(zip(model.joint_names, places, strict=True))
    head, feet = joints["head"], (joints["left_ankle"], joints["right_ankle"])
    upright = max(float(np.linalg.norm(head - foot)) for foot in feet) / straight_m
    raised = any(
        (joints[f"{side}_wrist"] - joints[f"{side}_shoulder"]) @ (head - joints["pelvis"]) > 0.0
        for side in ("left", "right")
    )
    if upright <= UPRIGHT_SHARE or raised:  # a raised hand may be mistaken for the head
        return None
    depth = subject.frame.metres().astype(np.float64)
    points, lengths = back_project(depth, subject.frame.intrinsics)[depth > 0.0], []
    for foot in feet:
        between = float(np.linalg.norm(head - foot))
        up = (head - foot) / between
        lengths.append(_find_end(subject, points, head, up) + between + _find_end(subject, points, foot, -up))
    length = max((each for each in lengths if np.isfinite(each)), default=None)
    return None if length is None else length / upright


def head_to_ankle(model: BodyModel) -> float:
    """Distance in metres from the head to the farther ankle of a body that stands straight."""
    joints = joint_positions(model, np.zeros((1, len(model.dof_names))))[0]
    head, *ankles = (joints[model.joint_names.index(n)] for n in ("head", "left_ankle", "right_ankle"))
    return max(float(np.linalg.norm(head - ankle)) for ankle in ankles)


def _find_end(subject: SubjectFrame, points: Array, joint: Array, outwards: Array) -> float:
    """Length (m) of the person, shown by points (P, 3), beyond a joint (3,); NaN if the end is hidden."""
    camera = subject.frame.intrinsics
    offset = points - joint
    along = offset @ outwards
    aside = np.einsum("pi,pi->p", offset, offset) - along * along
    along = np.sort(along[(np.abs(along) < SEARCH_RADIUS_M) & (aside < AXIS_RADIUS_M**2)])
    stray = int(STRAY_AREA_M2 * camera.fx * camera.fy / joint[2] ** 2)
    if len(along) <= stray:
        return float("nan")
    end = float(along[-1 - stray])
    if end < -HIDDEN_END_M:  # the points end far from the joint: something hides it
        return float("nan")
    beyond = joint + (end + 0.05) * outwards  # where the person would continue behind an occluder
    return float("nan") if _is_hidden(subject, beyond) else end


def _is_hidden(subject: SubjectFrame, point: Array) -> bool:
    """Whether a point (3,) is outside the image or behind something."""
    camera = subject.frame.intrinsics
    u = round(camera.cx + camera.fx * point[0] / point[2])
    v = round(camera.cy + camera.fy * point[1] / point[2])
    left, top, right, bottom = subject.view
    if not (left <= u < right and top <= v < bottom):
        return True
    labels = subject.kinds
    inside = labels is not None and 0 <= v < labels.shape[0] and 0 <= u < labels.shape[1]
    return labels is not None and inside and bool(labels[v, u] == HIDDEN)
