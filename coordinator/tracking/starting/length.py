"""How long a person who stands is in a frame, from the top of the head to a sole.

Closest points say little of it: few of them lie on head and feet, and a body that is too small or too large
stands on its toes or bends a little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import HIDDEN, SubjectFrame
from common.kinematics import joint_positions

Array = NDArray[np.float64]

HEAD = 0.14  # metres from the body's axis, within which points belong to the head
ABOVE = 0.3  # metres along it from the head's joint
FOOT = 0.2  # metres from an ankle
ARM = 0.3  # metres from the head, within which a hand may be taken for it
STRAY = 2.5e-4  # square metres of what lies beyond an end: stray points
FEWEST = 20  # points of an end
BEYOND = 0.05  # metres from an end to where it would go on if something hid it
SHOWN = 0.992  # of a stature, by which it says what points say (subjects 1, 2): outlines are cut off


def measure_length(model: BodyModel, pose: Array, subject: SubjectFrame) -> float | None:
    """Metres from the top of the head to the farther sole, of who stands about in this pose (D,) of a model.

    None where head or feet are not seen, or a hand is at the head. The model says only where to look, not how
    long the body is.
    """
    joints = dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))
    head = joints["head"]
    if min(np.linalg.norm(joints[f"{side}_wrist"] - head) for side in ("left", "right")) < ARM:
        return None
    crown, lengths = points_near(subject, head, ABOVE), []
    for foot in (joints["left_ankle"], joints["right_ankle"]):
        between = float(np.linalg.norm(head - foot))
        up = (head - foot) / between
        top = find_end(subject, crown, head, up)
        sole = find_end(subject, points_near(subject, foot, FOOT), foot, -up)
        lengths.append(top + between + sole)
    return max((length for length in lengths if np.isfinite(length)), default=None)


def find_end(subject: SubjectFrame, points: Array, joint: Array, outwards: Array) -> float:
    """How far points (P, 3) reach beyond a joint (3,); not a number where too few or more may be hidden."""
    camera = subject.frame.intrinsics
    stray = int(STRAY * camera.fx * camera.fy / joint[2] ** 2)
    end = reach(points, joint, outwards, stray)
    if np.isfinite(end) and is_hidden(subject, joint + (end + BEYOND) * outwards):
        return float("nan")
    return end


def reach(points: Array, joint: Array, outwards: Array, stray: int) -> float:
    """How far points (P, 3) about a joint reach in a direction (3,), but so many; not a number for few."""
    offset = points - joint
    along = offset @ outwards
    aside = np.einsum("pi,pi->p", offset, offset) - along * along
    mine = along[(np.abs(along) < ABOVE) & (aside < HEAD * HEAD)]
    return float(np.sort(mine)[-1 - stray]) if len(mine) >= FEWEST + stray else float("nan")


def points_near(subject: SubjectFrame, joint: Array, radius: float) -> Array:
    """All points (P, 3) of the subject in the square around a joint, camera frame, metres."""
    frame, camera = subject.frame, subject.frame.intrinsics
    x, y, z = joint
    u, v = camera.cx + camera.fx * x / z, camera.cy + camera.fy * y / z
    across, along = camera.fx * radius / z, camera.fy * radius / z
    height, width = frame.depth.shape
    above, below = np.clip([v - along, v + along + 1.0], 0, height).astype(int)
    left, right = np.clip([u - across, u + across + 1.0], 0, width).astype(int)
    depth = frame.depth[above:below, left:right]
    rows, columns = np.nonzero(depth)
    far = depth[rows, columns] / frame.depth_scale
    return np.stack(
        [(columns + left - camera.cx) / camera.fx * far, (rows + above - camera.cy) / camera.fy * far, far],
        axis=1,
    )


def is_hidden(subject: SubjectFrame, point: Array) -> bool:
    """Whether a point (3,) lies outside of what the camera saw, or behind something."""
    camera = subject.frame.intrinsics
    u = round(camera.cx + camera.fx * point[0] / point[2])
    v = round(camera.cy + camera.fy * point[1] / point[2])
    left, top, right, bottom = subject.view
    if not (left <= u < right and top <= v < bottom):
        return True
    kinds = subject.kinds
    inside = kinds is not None and 0 <= v < kinds.shape[0] and 0 <= u < kinds.shape[1]
    return kinds is not None and inside and bool(kinds[v, u] == HIDDEN)
