"""Poses in which people are searched for, drawn around modes: typical poses of arms, legs and trunk.

Modes are in degrees, with the signs of `gepf.coordinator.bodies.human.skeleton`.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.coordinator.bodies.random_poses import draw_orientations

RANDOM_ORIENTATION_SHARE = 0.1  # of the poses
ELEVATION_DEG = (-20.0, 50.0)  # range of the camera's downward pitch
SPREAD_DEG = 15.0  # standard deviation of joint angles around their mode, and of the trunk's roll

Angles = tuple[float, float, float, float]

ARM = ("shoulder_flexion", "shoulder_abduct", "shoulder_twisting", "elbow_flexion")
ARMS: tuple[Angles, ...] = (
    (0, 8, 0, 10),  # hanging
    (85, 5, 0, 10),  # points forward
    (0, 85, 0, 10),  # straight sideways
    (165, 10, 0, 15),  # overhead
    (-15, 45, 40, 80),  # hand on the hip
    (10, 10, 0, 90),  # forearm forward
    (40, 10, 60, 100),  # in front of the chest
    (70, 30, 0, 130),  # hand at the face
    (0, 90, -80, 85),  # hands up
)

LEG = ("hip_flexion", "hip_abduct", "hip_twisting", "knee_flexion")
STRAIGHT: Angles = (0, 3, 0, 5)
STANDING: tuple[tuple[Angles, Angles], ...] = (
    (STRAIGHT, STRAIGHT),
    ((0, 20, 0, 5), (0, 20, 0, 5)),  # wide
    ((30, 3, 0, 15), (-15, 3, 0, 20)),  # a stride
    ((80, 5, 0, 90), STRAIGHT),  # a knee lifted
    ((70, 3, 0, 10), STRAIGHT),  # a kick
)
LEGS = (
    *STANDING,
    ((70, 5, 0, 75), (-15, 3, 0, 35)),  # a lunge
    ((85, 10, 0, 90), (0, 5, 0, 95)),  # down on one knee
    ((85, 8, 0, 85), (85, 8, 0, 85)),  # sits
    ((110, 15, 0, 120), (110, 15, 0, 120)),  # squats
    ((0, 5, 0, 100), (0, 5, 0, 100)),  # kneels
    ((95, 8, 0, 140), (95, 8, 0, 140)),  # sits on the heels
    ((90, 5, 0, 10), (90, 5, 0, 10)),  # sits with the legs stretched out
)

TILTS = (0.0, 25.0, 55.0)


def draw_people(model: BodyModel, count: int, rng: np.random.Generator) -> Array:
    """Poses (N, D) around the modes, within the limits of the joints, seen from all sides.

    Each arm has its own mode. Legs have modes in pairs, also mirrored. Half of the people stand.
    """
    poses = np.zeros((count, len(model.dof_names)))
    for side in "lr":
        arm = np.array(ARMS)[rng.integers(len(ARMS), size=count)]
        put(model, poses, f"{side}_", ARM, arm + SPREAD_DEG * rng.standard_normal(arm.shape))
    chosen = rng.integers(len(LEGS), size=count)
    stands = rng.random(count) < 0.5
    chosen[stands] = rng.integers(len(STANDING), size=int(stands.sum()))
    pairs = np.array(LEGS, dtype=np.float64)[chosen]  # (N, 2, 4)
    swapped = rng.random(count) < 0.5
    pairs[swapped] = pairs[swapped, ::-1]
    pairs += SPREAD_DEG * rng.standard_normal(pairs.shape)
    for leg, side in enumerate("lr"):
        put(model, poses, f"{side}_", LEG, pairs[:, leg])
    tilt = np.array(TILTS)[rng.integers(len(TILTS), size=(count, 1))]
    put(model, poses, "", ("vl3_tilt",), tilt + SPREAD_DEG * rng.standard_normal(tilt.shape))
    np.clip(poses, model.limits[:, 0], model.limits[:, 1], out=poses)
    poses[:, model.root[3:]] = draw_headings(count, rng)
    return poses


def put(model: BodyModel, poses: Array, side: str, names: tuple[str, ...], degrees: Array) -> None:
    """Set the degrees of freedom with these names to angles (N, K) in degrees, if the model has them."""
    for k, name in enumerate(names):
        if side + name in model.dof_names:
            poses[:, model.dof(side + name)] = np.radians(degrees[:, k])


def draw_headings(count: int, rng: np.random.Generator) -> Array:
    """Angles (N, 3) of the root: any yaw, seen from above or below; some with any orientation."""
    down = np.radians(rng.uniform(*ELEVATION_DEG, size=count))
    yaw = rng.uniform(-np.pi, np.pi, size=count)
    lean = np.radians(SPREAD_DEG) * rng.standard_normal(count)
    angles = np.stack([down, yaw, lean], axis=-1)
    turned = rng.random(count) < RANDOM_ORIENTATION_SHARE
    angles[turned] = draw_orientations(int(turned.sum()), rng)
    return angles
