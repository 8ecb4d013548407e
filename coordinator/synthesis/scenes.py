"""Scenes of synthetic sequences: a body, its pose in every frame, the camera, and the start pose.

`arm`: one arm in front of a fixed body, four degrees of freedom (section 5 of the paper).

`turn`: a person moves arms and legs and turns, so that the right arm and leg are hidden for some time. It is
the situation of section 6 of the paper, with ground truth: 24 degrees of freedom, 180 frames. The right arm
hangs before it is hidden and is raised when it reappears, so a tracker with a single pose loses it.

`roam`: any body that moves all its joints randomly, smoothly and within their limits, in front of a Kinect.
The base is fixed, like that of a robot; a body without joints is moved and rotated as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import msgspec
import numpy as np
from scipy.interpolate import PchipInterpolator

from gepf.common.arrays import Array, Indices
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.synthesis.rendering import fit_in_view


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A body with D degrees of freedom that moves through F frames.

    `start` (D,) is the start pose for a tracker; None if it must detect the body. `others` are people in the
    same images. `room` is a surface around them: vertices (V, 3) and triangles (T, 3).
    """

    model: BodyModel
    camera: Intrinsics
    fps: float
    poses: Array  # (F, D) radians and metres
    start: Array | None  # (D,)
    others: tuple[Scene, ...] = ()
    room: tuple[Array, Indices] | None = None

    def __post_init__(self) -> None:
        self.poses.setflags(write=False)
        if self.start is not None:
            self.start.setflags(write=False)


def animate(model: BodyModel, angles_deg: dict[str, dict[int, float]], **metres: dict[int, float]) -> Array:
    """Poses (F, D) of a body from keyframes of some degrees of freedom; the others are zero.

    Between two keyframes a value moves smoothly without overshoot; before the first and after the last it is
    constant. The last keyframe of all is the last pose.
    """
    frames = 1 + max(max(keys) for keys in angles_deg.values())
    poses = np.zeros((frames, len(model.dof_names)))
    for name, keys in {**metres, **angles_deg}.items():
        values = np.array(list(keys.values()), dtype=np.float64)
        curve = PchipInterpolator(list(keys), np.radians(values) if name in angles_deg else values)
        poses[:, model.dof(name)] = curve(np.clip(np.arange(frames), min(keys), max(keys)))
    return poses


PAPER_CAMERA, PAPER_FPS = Intrinsics(512, 512, 790.0, 790.0, 255.5, 255.5), 25.0

ARM_DOFS = ("r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion")
ARM_STANDS = {"root_tx": 0.1, "root_ty": 0.04, "root_tz": 3.21}  # the raised hand stays in the image
ARM_STARTS_OFF_DEG = {"r_shoulder_abduct": -50.0}  # difference from the truth of the first frame

# Degrees by frame. The forearm is close to the body, its hand at the head, around frames 60 and 105. The
# upper arm never comes back to where a lone particle gets stuck, inside the trunk. The elbow is never
# straight, where twisting could not be seen, and abduction stays far from 90, where flexion and twisting turn
# about one axis.
ARM_KEYS_DEG: dict[str, dict[int, float]] = {
    "r_shoulder_flexion": {0: 56, 32: 62, 60: 104, 82: 90, 105: 117, 142: 60, 175: 78},
    "r_shoulder_abduct": {0: 26, 28: 62, 60: 6, 82: 46, 105: 10, 136: 68, 160: 34, 175: 30},
    "r_shoulder_twisting": {0: 0, 25: -22, 60: 8, 82: -16, 105: 36, 142: -26, 175: 5},
    "r_elbow_flexion": {0: 48, 30: 76, 60: 112, 82: 66, 105: 112, 138: 48, 175: 70},
}


@cache
def arm() -> Scene:
    """A standing person swings the right arm; one shoulder angle starts with an error of 50 degrees."""
    model = human()
    poses = animate(model, ARM_KEYS_DEG)
    for name, value in ARM_STANDS.items():
        poses[:, model.dof(name)] = value
    start = poses[0].copy()
    for name, degrees in ARM_STARTS_OFF_DEG.items():
        start[model.dof(name)] += np.radians(degrees)
    return Scene(model, PAPER_CAMERA, PAPER_FPS, poses, start)


TURN_PLACE_M: dict[str, dict[int, float]] = {
    "root_tx": {0: 0.0, 60: 0.08, 120: -0.06, 179: 0.0},
    "root_ty": {0: -0.01, 179: -0.01},
    "root_tz": {0: 3.3, 60: 3.2, 120: 3.4, 179: 3.3},
}
TURN_KEYS_DEG: dict[str, dict[int, float]] = {
    "root_rx": {0: 0, 60: 4, 120: -2, 179: 0},
    "root_ry": {0: 0, 30: 12, 60: -10, 88: 0, 112: 0, 119: 80, 128: 84, 146: 84, 153: 10, 179: -10},
    "root_rz": {0: 0, 45: 3, 90: -3, 179: 0},
    "l_shoulder_flexion": {0: 10, 25: 65, 50: 20, 80: 60, 110: 10, 140: 50, 179: 15},
    "l_shoulder_abduct": {0: 15, 25: 35, 50: 8, 80: 55, 110: 15, 140: 5, 179: 15},
    "l_shoulder_twisting": {0: 0, 40: 25, 80: -15, 120: 15, 179: 0},
    "l_elbow_flexion": {0: 20, 25: 60, 50: 30, 80: 80, 110: 30, 140: 55, 179: 25},
    "r_shoulder_flexion": {0: 10, 30: 20, 55: 75, 85: 30, 110: 25, 135: -20, 153: 110, 179: 110},
    "r_shoulder_abduct": {0: 15, 30: 60, 55: 20, 85: 50, 110: 15, 135: 4, 153: 40, 179: 40},
    "r_shoulder_twisting": {0: 0, 40: -20, 75: 30, 115: 0, 153: 0, 179: 0},
    "r_elbow_flexion": {0: 25, 30: 60, 55: 85, 85: 40, 110: 30, 135: 22, 153: 100, 179: 100},
    "l_hip_flexion": {14: 0, 32: 40, 57: 0, 80: 35, 98: 0, 114: -12, 128: 9, 146: 15, 160: 26, 179: 0},
    "l_hip_abduct": {0: 4, 32: 12, 62: 4, 80: 14, 110: 2, 179: 4},
    "l_hip_twisting": {0: 0, 32: -12, 62: 0, 80: 10, 120: 0, 179: 0},
    "l_knee_flexion": {14: 5, 32: 60, 57: 5, 80: 55, 98: 5, 114: 20, 128: 14, 146: 20, 160: 25, 179: 5},
    "l_ankle_flexion": {0: 0, 32: -15, 62: 0, 80: 10, 110: 0, 145: 8, 179: 0},
    "r_hip_flexion": {0: 0, 30: 0, 50: 45, 70: 0, 98: -5, 112: 24, 128: 6, 146: 12, 160: -10, 179: 0},
    "r_hip_abduct": {0: 4, 50: 14, 75: 4, 110: 2, 150: 2, 179: 4},
    "r_hip_twisting": {0: 0, 50: 12, 75: 0, 179: 0},
    "r_knee_flexion": {0: 5, 30: 5, 50: 65, 70: 5, 98: 8, 112: 35, 128: 14, 146: 20, 160: 35, 179: 5},
    "r_ankle_flexion": {0: 0, 50: -12, 75: 0, 125: 10, 145: -10, 179: 0},
}


@cache
def turn() -> Scene:
    """Arms and legs move, the body turns by 84 degrees and back; tracking starts from the truth."""
    model = human()
    poses = animate(model, TURN_KEYS_DEG, **TURN_PLACE_M)
    return Scene(model, PAPER_CAMERA, PAPER_FPS, poses, poses[0])


class Roam(msgspec.Struct, frozen=True):
    """How any body moves, and in front of which camera."""

    frames: int = 150
    camera: Intrinsics = Intrinsics(640, 480, 575.0, 575.0, 319.5, 239.5)
    turn_deg: float = 40.0  #: to either side, if the limits allow
    slide_m: float = 0.15  #: the same
    range_share: float = 0.4  #: of the range between the limits, to either side of the centre
    carried_m: float = 0.08  #: of a body without joints, to either side
    carried_turn_deg: float = 35.0  #: the same
    max_distance_m: float = 6.0


ROAM = Roam()
ROAM_STANDS = {"root_rx": 0.2, "root_ry": 0.5}  # seen from above and from the side


def roam(model: BodyModel, seed: int = 0, frames: int = ROAM.frames) -> Scene:
    """A scene of a body; the same seed gives the same motion. Tracking starts from the truth.

    Raises InputError for a body that is too large for the image.
    """
    rng = np.random.default_rng([seed, 1])
    middle, reach = swing(model)
    second = round(DEFAULT_FPS)  # between keyframes
    keys = rng.uniform(-1.0, 1.0, (frames // second + 2, len(middle))) * reach + middle
    poses = np.asarray(PchipInterpolator(second * np.arange(len(keys)), keys)(np.arange(frames)))
    for name, value in ROAM_STANDS.items():
        poses[:, model.dof(name)] += value
    seen = pose_vertices(model, poses[:: max(1, len(poses) // 20)]).reshape(-1, 3)
    shift = fit_in_view(seen, ROAM.camera)
    if seen[:, 2].max() + shift[2] > ROAM.max_distance_m:
        size = np.ptp(seen, axis=0).max()
        raise InputError(f"{model.name} is {size:.1f} m large and would be too far away; give a smaller body")
    poses[:, model.root[:3]] += shift
    return Scene(model, ROAM.camera, DEFAULT_FPS, poses, poses[0].copy())


def swing(model: BodyModel) -> tuple[Array, Array]:
    """Middle and amplitude (D,) of each degree of freedom's motion."""
    rotates = model.kinds == ROTATION
    root = np.array([name in ROOT_DOFS for name in model.dof_names])
    if root.all():
        return np.zeros(len(root)), np.where(rotates, np.radians(ROAM.carried_turn_deg), ROAM.carried_m)
    bounded = np.all(np.isfinite(model.limits), axis=1, keepdims=True)
    low, high = np.where(bounded, model.limits, 0.0).T
    reach = np.where(rotates, np.radians(ROAM.turn_deg), ROAM.slide_m)
    reach = np.where(bounded[:, 0], np.minimum(reach, ROAM.range_share * (high - low)), reach)
    return 0.5 * (low + high), np.where(root, 0.0, reach)


SCENES = {"arm": arm, "turn": turn}
