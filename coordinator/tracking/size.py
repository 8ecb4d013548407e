"""A person's stature, from how far head and soles are apart in the first frames that show both.

Closest points say little of stature: few of them lie on head and feet, and a body that is too small or too
large stands on its toes or bends a little. So the length is measured in the depth image, and the model says
only where to look. The median over a window of frames is off by less than 1 cm for a standing person; then
the stature stays, unless a later window contradicts it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import HIDDEN, SubjectFrame
from common.kinematics import joint_positions

Array = NDArray[np.float64]

INTERVAL_S = 0.095  # between measured frames, at least: frames beside each other share their errors
WINDOW_FRAMES = 15  # the median over as many is within 1 cm of the next window's (subjects 1 and 2)
MEAN_STATURE_M = 1.69  # of men and women (ANSUR II)
LEAST_CHANGE_SHARE = 0.005  # of stature: for less, a new body is not worth its making
CONTRADICTION_SHARE = 0.03  # of stature, by which a later window must differ: three times a window's error
UPRIGHT_SHARE = 0.97  # of the length at rest, below which a bent body does not show its stature
OUTLINE_SHARE = 0.992  # of the stature shows: an outline's last pixels are cut off (subjects 1 and 2)
SEARCH_RADIUS_M = 0.3  # around head and ankle, in which their ends are sought
AXIS_RADIUS_M = 0.14  # from the body's axis: the width of a head
HIDDEN_END_M = 0.06  # before the joint of a body that is too large, points may end
STRAY_AREA_M2 = 2.5e-4  # beyond an end: stray points


@dataclass(frozen=True, slots=True)
class SizeEstimate:
    """Statures (m) measured in the present window of frames; settled once a window is full."""

    statures: tuple[float, ...] = ()
    settled: bool = False
    time_s: float = -np.inf  # of the last measured frame

    def is_due(self, time_s: float) -> bool:
        """Whether the frame of this time is to be measured."""
        return not 0.0 <= time_s - self.time_s < INTERVAL_S

    def add(self, stature: float, time_s: float) -> Self:
        """With the stature (m) that one more frame shows; after a full window a new one begins."""
        if len(self.statures) < WINDOW_FRAMES:
            return replace(self, statures=(*self.statures, stature), time_s=time_s)
        return replace(self, statures=(stature,), settled=True, time_s=time_s)

    def revise(self, stature: float) -> float:
        """The stature (m) of the body from now on, in place of this one."""
        if not self.statures:
            return stature
        measured = float(np.median(self.statures))
        due = len(self.statures) == WINDOW_FRAMES or not self.settled
        least = CONTRADICTION_SHARE if self.settled else LEAST_CHANGE_SHARE
        return measured if due and abs(measured / stature - 1.0) > least else stature


def measure_stature(model: BodyModel, pose: Array, straight_m: float, subject: SubjectFrame) -> float | None:
    """Stature in metres of a person who stands about in pose (D,); None where a frame does not show it.

    A person who leans or bends a little is straightened: by as much as the model's head is nearer to its
    ankles than that of a model which stands straight.

    Args:
        model: The body as it is tracked.
        pose: Its pose in the frame.
        straight_m: Distance from head to ankle of this body standing straight.
        subject: The person's pixels.
    """
    joints = dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))
    head, feet = joints["head"], (joints["left_ankle"], joints["right_ankle"])
    upright = max(float(np.linalg.norm(head - foot)) for foot in feet) / straight_m
    raised = any(
        (joints[f"{side}_wrist"] - joints[f"{side}_shoulder"]) @ (head - joints["pelvis"]) > 0.0
        for side in ("left", "right")
    )
    if upright <= UPRIGHT_SHARE or raised:  # a raised hand may be taken for the head
        return None
    lengths = []
    for foot in feet:
        between = float(np.linalg.norm(head - foot))
        up = (head - foot) / between
        lengths.append(_find_end(subject, head, up) + between + _find_end(subject, foot, -up))
    length = max((each for each in lengths if np.isfinite(each)), default=None)
    return None if length is None else length / (OUTLINE_SHARE * upright)


def head_to_ankle(model: BodyModel) -> float:
    """Metres from the head to the farther ankle of a body that stands straight."""
    joints = joint_positions(model, np.zeros((1, len(model.dof_names))))[0]
    head, *ankles = (joints[model.joint_names.index(n)] for n in ("head", "left_ankle", "right_ankle"))
    return max(float(np.linalg.norm(head - ankle)) for ankle in ankles)


def _find_end(subject: SubjectFrame, joint: Array, outwards: Array) -> float:
    """How far the person reaches beyond a joint (3,), metres; NaN where something hides it."""
    camera = subject.frame.intrinsics
    points = _points_near(subject, joint)
    offset = points - joint
    along = offset @ outwards
    aside = np.einsum("pi,pi->p", offset, offset) - along * along
    along = np.sort(along[(np.abs(along) < SEARCH_RADIUS_M) & (aside < AXIS_RADIUS_M**2)])
    stray = int(STRAY_AREA_M2 * camera.fx * camera.fy / joint[2] ** 2)
    if len(along) <= stray:
        return float("nan")
    end = float(along[-1 - stray])
    if end < -HIDDEN_END_M:  # the points end well before the joint: something hides it
        return float("nan")
    beyond = joint + (end + 0.05) * outwards  # where the person would go on if something hid them
    return float("nan") if _is_hidden(subject, beyond) else end


def _points_near(subject: SubjectFrame, joint: Array) -> Array:
    """All points (P, 3) of the subject in the square around a joint, camera frame, metres."""
    frame, camera = subject.frame, subject.frame.intrinsics
    x, y, z = joint
    u, v = camera.cx + camera.fx * x / z, camera.cy + camera.fy * y / z
    across, along = camera.fx * SEARCH_RADIUS_M / z, camera.fy * SEARCH_RADIUS_M / z
    height, width = frame.depth.shape
    top, bottom = np.clip([v - along, v + along + 1.0], 0, height).astype(int)
    left, right = np.clip([u - across, u + across + 1.0], 0, width).astype(int)
    depth = frame.depth[top:bottom, left:right]
    rows, columns = np.nonzero(depth)
    far = depth[rows, columns] / frame.depth_scale
    return np.stack(
        [(columns + left - camera.cx) / camera.fx * far, (rows + top - camera.cy) / camera.fy * far, far],
        axis=1,
    )


def _is_hidden(subject: SubjectFrame, point: Array) -> bool:
    """Whether a point (3,) lies outside of what the camera saw, or behind something."""
    camera = subject.frame.intrinsics
    u = round(camera.cx + camera.fx * point[0] / point[2])
    v = round(camera.cy + camera.fy * point[1] / point[2])
    left, top, right, bottom = subject.view
    if not (left <= u < right and top <= v < bottom):
        return True
    labels = subject.kinds
    inside = labels is not None and 0 <= v < labels.shape[0] and 0 <= u < labels.shape[1]
    return labels is not None and inside and bool(labels[v, u] == HIDDEN)
