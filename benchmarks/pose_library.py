"""Builds the poses in which people are detected: python -m benchmarks.pose_library MOCAP.

MOCAP is a file of recorded joints: `joint_names` (31,) and for each clip the joints (F, 31, 3), metres, y up,
30 frames per second, of the CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu, NSF EIA-0196217, free
for all uses). They are converted to the degrees of freedom of a tracked person.

Recorded poses, and poses within the ranges of the synthesis and of people who sit and kneel, are combined
limb by limb and seen from all sides. Of this pool, those poses are chosen that represent it best: greedy
k-medoids in the distance of the descriptor by which people are detected. So the first poses of the result
also represent the pool, more coarsely. Half a minute on one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics import joint_positions
from gepf.common.kinematics.rotations import euler_angles, euler_matrix
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.people import People
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, Size
from gepf.coordinator.bodies.human.typical_poses import POSES_FILE, UNIT_RAD
from gepf.coordinator.bodies.random_poses import draw_orientations
from gepf.coordinator.settings import SearchSettings
from gepf.coordinator.synthesis.person_scene import ARM, BEND, BENT, LIFTED, TRUNK, Ranges, draw_arm, is_clear
from gepf.coordinator.tracking.descriptor import Image, fill_differences
from gepf.coordinator.tracking.pose_library import describe_poses

RECORDED = {
    "neck": "lowerneck", "head": "head",
    **{f"{side}_{ours}": side[0] + theirs for side in ("left", "right") for ours, theirs in (
        ("shoulder", "clavicle"), ("elbow", "humerus"), ("wrist", "radius"),
        ("hip", "hipjoint"), ("knee", "femur"), ("ankle", "tibia"),
    )},
}  # fmt: skip
"""Our joints -> the recorded ones: each is the far end of the bone of its name."""
LIMBS = {"elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee"}
"""The joint at the upper end of a bone."""

Y_DOWN = np.array([1.0, -1.0, -1.0])
EVERY = 10  # n-th frame of 30 a second
STARTS_DEG: tuple[dict[str, float], ...] = (
    {},
    {"shoulder_flexion": 90.0, "elbow_flexion": 60.0, "hip_flexion": 45.0, "knee_flexion": 60.0},
    {"shoulder_abduct": 80.0, "elbow_flexion": 60.0, "hip_abduct": 30.0, "knee_flexion": 20.0},
    {"shoulder_flexion": 150.0, "elbow_flexion": 30.0, "hip_flexion": 90.0, "knee_flexion": 100.0},
)
"""From which a pose is fitted, until it fits well."""
FIT_STEPS, DAMPING, REST_M = 15, 1e-4, 0.01  # REST_M: by which a joint may be off per radian of an angle
MISFIT_M = 0.03  # mean distance of the joints up to which a pose fits well; others are not used


def recorded_joints(clips: Mapping[str, Array], names: list[str]) -> Array:
    """Recorded poses (N, J, 3): joints in the order of RECORDED from the middle of the hips, y down.

    They face the camera: the line through the hips is parallel to the image.
    """
    columns = [names.index(theirs) for theirs in RECORDED.values()]
    joints = np.concatenate([clip[::EVERY, columns].astype(np.float64) for clip in clips.values()]) * Y_DOWN
    ours = list(RECORDED)
    left, right = (joints[:, ours.index(f"{side}_hip")] for side in ("left", "right"))
    joints = joints - 0.5 * (left + right)[:, None]
    heading = np.arctan2(-(left - right)[:, 2], (left - right)[:, 0])
    c, s, zero, one = np.cos(heading), np.sin(heading), np.zeros(len(heading)), np.ones(len(heading))
    turns = np.array([[c, zero, -s], [zero, one, zero], [s, zero, c]])
    posed: Array = np.einsum("ijf,fkj->fki", turns, joints)
    return posed


def resized(model: BodyModel, joints: Array) -> Array:
    """Recorded joints (N, J, 3) with the lengths of a body's bones, in the order of its own joints."""
    rest = dict(
        zip(model.joint_names, joint_positions(model, np.zeros((1, len(model.kinds))))[0], strict=True)
    )
    at = dict(zip(RECORDED, np.moveaxis(joints, 1, 0), strict=True))
    out = {"pelvis": np.zeros((len(joints), 3))}

    def reach(start: Array, towards: Array, length: float) -> Array:
        return np.asarray(start + length * towards / np.linalg.norm(towards, axis=-1, keepdims=True))

    def length(first: str, second: str) -> float:
        return float(np.linalg.norm(rest[first] - rest[second]))

    out["neck"] = reach(out["pelvis"], at["neck"], length("pelvis", "neck"))
    out["head"] = reach(out["neck"], at["head"] - at["neck"], length("neck", "head"))
    for pair in ("shoulder", "hip"):
        left, right = f"left_{pair}", f"right_{pair}"
        middle = 0.5 * (rest[left] + rest[right])
        centre = out["pelvis"]
        if pair == "shoulder":
            centre = reach(centre, 0.5 * (at[left] + at[right]), float(np.linalg.norm(middle)))
        for name, other in ((left, right), (right, left)):
            out[name] = reach(centre, at[name] - at[other], 0.5 * length(left, right))
    for lower, upper in LIMBS.items():
        for side in ("left", "right"):
            first, second = f"{side}_{upper}", f"{side}_{lower}"
            out[second] = reach(out[first], at[second] - at[first], length(first, second))
    return np.stack([out[name] for name in model.joint_names], axis=1)


def fit(model: BodyModel, joints: Array) -> tuple[Array, Array]:
    """Poses (N, D) within the limits whose joints are nearest to (N, J, 3), and their mean distances (N,).

    Damped Gauss-Newton, from several poses.
    """
    best, error = np.zeros((len(joints), len(model.kinds))), np.full(len(joints), np.inf)
    for start in STARTS_DEG:
        left = np.flatnonzero(error > MISFIT_M)
        if not len(left):
            break
        poses = np.zeros_like(best[left])
        poses[:, 3:6] = facing(model, joints[left])
        for name, degrees in start.items():
            for side in "lr":
                poses[:, model.dof(f"{side}_{name}")] = np.radians(degrees)
        for _ in range(FIT_STEPS):
            poses = step(model, poses, joints[left])
        off = np.linalg.norm(joint_positions(model, poses) - joints[left], axis=-1).mean(axis=-1)
        nearer = off < error[left]
        best[left[nearer]], error[left[nearer]] = poses[nearer], off[nearer]
    return best, error


def facing(model: BodyModel, joints: Array) -> Array:
    """Angles (N, 3) of the root by the hips and the neck of joints (N, J, 3)."""
    at = {name: joints[:, j] for j, name in enumerate(model.joint_names)}
    left, down = at["left_hip"] - at["right_hip"], -at["neck"]
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    back = np.cross(left, down)
    back /= np.linalg.norm(back, axis=-1, keepdims=True)
    turns = np.stack([left, np.cross(back, left), back], axis=-1)
    return np.array([euler_angles(turn, np.zeros(3)) for turn in turns])


def step(model: BodyModel, poses: Array, joints: Array) -> Array:
    """A damped Gauss-Newton step of poses (N, D) towards joints (N, J, 3), clipped to the limits."""
    count, dofs, small = len(poses), poses.shape[1], 1e-4
    at = joint_positions(model, poses).reshape(count, -1)
    jacobian = np.empty((count, at.shape[1], dofs))
    for d in range(dofs):
        moved = poses.copy()
        moved[:, d] += small
        jacobian[:, :, d] = (joint_positions(model, moved).reshape(count, -1) - at) / small
    rest = np.array([0.0 if name in ROOT_DOFS else REST_M**2 for name in model.dof_names])
    matrix = np.einsum("nri,nrj->nij", jacobian, jacobian) + np.diag(rest + DAMPING)
    pull = np.einsum("nri,nr->ni", jacobian, joints.reshape(count, -1) - at) - rest * poses
    moved = poses + np.clip(np.linalg.solve(matrix, pull[..., None])[..., 0], -0.5, 0.5)
    return np.asarray(np.clip(moved, model.limits[:, 0], model.limits[:, 1]))


SEATED: Ranges = {
    "hip_flexion": (50, 115), "hip_abduct": (0, 25), "hip_twisting": (-15, 15), "knee_flexion": (5, 140),
}  # fmt: skip
HANGING: Ranges = {
    "shoulder_flexion": (-20, 20), "shoulder_abduct": (0, 45), "shoulder_twisting": (-20, 20),
    "elbow_flexion": (0, 90),
}  # fmt: skip
KNEELING: Ranges = {"hip_flexion": (-10, 100), "hip_abduct": (0, 20), "knee_flexion": (80, 150)}
STANDING: Ranges = {"hip_flexion": (-5, 10), "hip_abduct": (0, 15), "knee_flexion": (0, 15)}
UPRIGHT: Ranges = {"vl3_tilt": (-5, 10), "vl3_roll": (-5, 5), "vl3_torsion": (-10, 10)}
KINDS: tuple[tuple[Ranges, Ranges], ...] = (
    ({}, {}),  # both legs bend
    (LIFTED, STANDING), (STANDING, LIFTED),
    (SEATED, SEATED),
    (KNEELING, KNEELING), (SEATED, KNEELING), (KNEELING, SEATED),
)  # fmt: skip
POOL = 9_000  # poses
RANDOM_ORIENTATION_SHARE = 0.1  # of people's poses
ELEVATION_DEG = (-20.0, 50.0)  # range of the camera's downward pitch
LEAN_DEG = 15.0  # standard deviation of the camera's roll
RECORDED_LEGS = 0.25  # share; half of all people stand
STRAIGHT_PERCENT = 2.0  # of recorded elbows and knees


def mirrored(model: BodyModel, poses: Array) -> Array:
    """The mirror images of poses (N, D)."""
    names = list(model.dof_names)
    other = {"l_": "r_", "r_": "l_"}
    columns = [names.index(other.get(name[:2], name[:2]) + name[2:]) for name in names]
    across = ("root_tx", "root_ry", "root_rz")
    signs = np.array([-1.0 if n in across or n.endswith(("_roll", "_torsion")) else 1.0 for n in names])
    return np.asarray(poses[:, columns] * signs)


def straightened(model: BodyModel, poses: Array) -> Array:
    """Poses (N, D) whose straightest elbows and knees are straight.

    Recorded joints lie beside the axes of rotation, so recorded limbs are always somewhat bent.
    """
    poses = poses.copy()
    for name in ("elbow_flexion", "knee_flexion"):
        columns = [model.dof(f"{side}_{name}") for side in "lr"]
        straight = max(0.0, float(np.percentile(poses[:, columns], STRAIGHT_PERCENT)))
        poses[:, columns] = np.maximum(poses[:, columns] - straight, 0.0)
    return poses


def combine(model: BodyModel, recorded: Array, count: int, rng: np.random.Generator) -> Array:
    """Poses (count, D) of people seen from all sides, with the root at the origin.

    A third of the arms and a quarter of the lower bodies are those of recorded poses (N, D) or of their
    mirror images. The others are drawn from ranges of joints; half of these people are upright, and half of
    these arms hang.
    """
    recorded = np.concatenate([recorded, mirrored(model, recorded)])

    def some() -> Array:
        return recorded[rng.integers(len(recorded), size=count)]

    poses = some()
    upright = rng.random(count) >= RECORDED_LEGS
    poses[upright] = 0.0
    draw_legs(model, poses, upright, rng)
    for side in "lr":
        draw_arms(model, poses, side, recorded, rng)
    for pose, view in zip(poses, turns(count, rng), strict=True):
        pose[3:6] = euler_angles(euler_matrix(view) @ euler_matrix(pose[3:6]), view)
    poses[:, :3] = 0.0
    return np.asarray(np.clip(poses, model.limits[:, 0], model.limits[:, 1]))


def turns(count: int, rng: np.random.Generator) -> Array:
    """Angles (N, 3) of the root: any yaw, seen from above or below; some with any orientation."""
    down = np.radians(rng.uniform(*ELEVATION_DEG, size=count))
    yaw = rng.uniform(-np.pi, np.pi, size=count)
    lean = np.radians(LEAN_DEG) * rng.standard_normal(count)
    angles = np.stack([down, yaw, lean], axis=-1)
    turned = rng.random(count) < RANDOM_ORIENTATION_SHARE
    angles[turned] = draw_orientations(int(turned.sum()), rng)
    return angles


def draw_arms(model: BodyModel, poses: Array, side: str, recorded: Array, rng: np.random.Generator) -> None:
    """Draw the arms of a side of poses (N, D), beside the trunk: thirds that hang, move and are recorded."""
    names = [f"{side}_{name}" for name in ARM]
    columns, whole = [model.dof(name) for name in names], "left" if side == "l" else "right"
    arms = recorded[:, columns]
    clear = [is_clear(model, dict(zip(names, arm, strict=True)), whole) for arm in np.degrees(arms).tolist()]
    arms = arms[clear]
    kind = rng.integers(3, size=len(poses))
    poses[:, columns] = arms[rng.integers(len(arms), size=len(poses))]
    draw(model, poses, f"{side}_", HANGING, kind == 1, rng)
    for n in np.flatnonzero(kind == 2):
        for name, degrees in draw_arm(model, side, rng).items():
            poses[n, model.dof(name)] = np.radians(degrees)


def draw_legs(model: BodyModel, poses: Array, some: Mask, rng: np.random.Generator) -> None:
    """Draw trunk and legs of some (N,) of the poses (N, D): half are upright, others bend, sit or kneel."""
    kind = np.where(some, rng.integers(2 * len(KINDS), size=len(poses)), -1)
    draw(model, poses, "", TRUNK, some, rng)
    draw(model, poses, "", UPRIGHT, kind >= len(KINDS), rng)
    for side in "lr":
        draw(model, poses, f"{side}_", STANDING, some, rng)
    bend = np.radians(rng.uniform(*BEND, size=len(poses)))
    for name, share in BENT.items():
        for side in "lr":
            poses[kind == 0, model.dof(f"{side}_{name}")] = share * bend[kind == 0]
    for legs, (left, right) in enumerate(KINDS[1:], start=1):
        draw(model, poses, "l_", left, kind == legs, rng)
        draw(model, poses, "r_", right, kind == legs, rng)


def draw(
    model: BodyModel, poses: Array, prefix: str, ranges: Ranges, some: Mask, rng: np.random.Generator
) -> None:
    """Draw the degrees of freedom of ranges (degrees) for some (N,) of the poses (N, D)."""
    for name, limits in ranges.items():
        if prefix + name in model.dof_names:
            drawn = np.radians(rng.uniform(*limits, size=len(poses)))
            poses[some, model.dof(prefix + name)] = drawn[some]


def differences(model: BodyModel, poses: Array) -> NDArray[np.float32]:
    """Differences (N, N) of the descriptors of poses (N, D), as the library compares them."""
    settings = SearchSettings()
    library = describe_poses(model, poses, People.cell_m, settings)
    images, bound = np.ascontiguousarray(library.cells.T), settings.max_cell_difference * People.cell_m
    apart = np.empty((len(poses), len(poses)), dtype=np.float32)
    for n, image in enumerate(images):
        fill_differences(library.cells, library.occupied, image, bound, apart[n])
        apart[n] /= library.occupied[n] + library.occupied
    return apart


@numba.njit(cache=True, nogil=True)
def choose_medoids(apart: Image, count: int) -> Indices:
    """The poses (count,) that represent all N best, by their differences (N, N), the best first.

    Each next one reduces the sum of the differences of all poses from the nearest chosen one most. As that
    reduction never grows, it is computed again only for poses whose last value is the largest.
    """
    total = len(apart)
    nearest = np.full(total, apart.max())
    gain = np.full(total, np.inf)
    chosen = np.empty(count, dtype=np.int64)
    for n in range(count):
        fresh = np.zeros(total, dtype=np.bool_)
        best = int(np.argmax(gain))
        while not fresh[best]:
            gain[best] = np.maximum(nearest - apart[best], np.float32(0.0)).sum()
            fresh[best] = True
            best = int(np.argmax(gain))
        chosen[n] = best
        gain[best] = -1.0
        nearest = np.minimum(nearest, apart[best])
    return chosen


def build(clips: Mapping[str, Array], names: list[str]) -> dict[str, Array]:
    """The arrays of the file: names (D,) of degrees of freedom, and poses (N, D) in whole units."""
    bodies, rng = choose_bodies(None, "default"), np.random.default_rng(0)
    model = bodies.for_start(*Size(REFERENCE_STATURE, 1.0))
    poses, error = fit(model, resized(model, recorded_joints(clips, names)))
    pool = combine(model, straightened(model, poses[error < MISFIT_M]), POOL, rng)
    chosen = pool[choose_medoids(differences(model, pool), SearchSettings().library_poses)]
    moving = [n for n, name in enumerate(model.dof_names) if name not in ROOT_DOFS[:3]]
    units = np.rint(chosen[:, moving] / UNIT_RAD).astype(np.int16)
    return {"dof_names": np.array(model.dof_names)[moving], "poses": units}


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.pose_library", description=__doc__)
    parser.add_argument("mocap", type=Path)
    parser.add_argument("file", type=Path, nargs="?", default=POSES_FILE)
    options = parser.parse_args()
    with np.load(options.mocap) as content:
        clips = {name: content[name] for name in content.files if name != "joint_names"}
        names = [str(name) for name in content["joint_names"]]
    np.savez_compressed(options.file, allow_pickle=False, **build(clips, names))
