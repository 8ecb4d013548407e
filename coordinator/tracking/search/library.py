"""Poses that a body may be found in, each with how it looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.compiling import numba
from common.kinematics import joint_positions, link_transforms
from common.kinematics.rotations import euler_angles
from coordinator.tracking.search import modes
from coordinator.tracking.search.signature import BOUND, CELL, COLUMNS, ROWS, sign

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SEED = 20  # of the library, whatever the run's
PEOPLE = 3000  # poses of a person
OTHERS = 6000  # of any other body, which may be turned in any way
VERTICES = 1700  # of the surface, that are enough to fill the cells
TUMBLED = 0.1  # of people's poses are turned in any way
ELEVATION = (-20.0, 50.0)  # degrees, that a camera looks down from
LEAN = 8.0  # degrees, standard deviation


@dataclass(frozen=True, slots=True, eq=False)
class Library:
    """Poses (N, D) with the root's place at zero, and their signatures.

    middles: Of each signature, relative to the root, metres. `cells` are laid out as `compare` wants them.
    """

    poses: Array  # (N, D)
    joints: Array  # (N, J, 3)
    middles: Array  # (N, 3)
    cells: NDArray[np.float32]  # (ROWS * COLUMNS, N)
    occupied: Array  # (N,)
    cell: float  # metres
    bound: float  # metres


def people_library(model: BodyModel) -> Library:
    """The library of a person whose degrees of freedom have their MPEG-4 names."""
    return look_at(model, draw_people(model, PEOPLE, np.random.default_rng(SEED)), CELL)


def any_library(model: BodyModel) -> Library:
    """The library of any body: joints anywhere in their ranges, turned in any way."""
    poses = draw_any(model, OTHERS, np.random.default_rng(SEED))
    return look_at(model, poses, 1.1 * reach(model, poses) / COLUMNS)


def draw_people(model: BodyModel, count: int, rng: np.random.Generator) -> Array:
    """Poses (N, D) around the modes, seen from all sides and from somewhat above or below."""
    pose = np.zeros((count, len(model.dof_names)))
    place_limbs(model, pose, rng)
    place_trunk(model, pose, rng)
    np.clip(pose, model.limits[:, 0], model.limits[:, 1], out=pose)
    pose[:, 3:6] = turns(count, rng)
    return pose


def place_limbs(model: BodyModel, poses: Array, rng: np.random.Generator) -> None:
    """Arms, each in a mode of its own, and pairs of legs, either way round."""
    count, spread = len(poses), modes.SPREAD
    for side in "lr":
        arm = np.array(modes.ARMS)[rng.integers(len(modes.ARMS), size=count)]
        put(model, poses, f"{side}_", modes.ARM, arm + spread.arm * rng.standard_normal(arm.shape))
    chosen = rng.integers(len(modes.LEGS), size=count)
    stands = rng.random(count) < 0.5
    chosen[stands] = rng.integers(modes.USUAL_LEGS, size=int(stands.sum()))
    pairs = np.array(modes.LEGS, dtype=np.float64)[chosen]  # (N, 2, 4)
    swapped = rng.random(count) < 0.5
    pairs[swapped] = pairs[swapped, ::-1]
    pairs += spread.leg * rng.standard_normal(pairs.shape)
    for leg, side in enumerate("lr"):
        put(model, poses, f"{side}_", modes.LEG, pairs[:, leg])


def place_trunk(model: BodyModel, poses: Array, rng: np.random.Generator) -> None:
    """Upright or bent."""
    tilt = np.array(modes.TILTS)[rng.integers(len(modes.TILTS), size=(len(poses), 1))]
    put(model, poses, "", modes.TILT, tilt + modes.SPREAD.trunk * rng.standard_normal(tilt.shape))


def put(model: BodyModel, poses: Array, side: str, names: tuple[str, ...], degrees: Array) -> None:
    """Write degrees (N, K) to the degrees of freedom of these names, where the model has them."""
    for k, name in enumerate(names):
        if side + name in model.dof_names:
            poses[:, model.dof(side + name)] = np.radians(degrees[:, k])


def turns(count: int, rng: np.random.Generator) -> Array:
    """Angles (N, 3) of the root: yaw all round, seen from above or below; some turned in any way."""
    down = np.radians(rng.uniform(*ELEVATION, size=count))
    yaw = rng.uniform(-np.pi, np.pi, size=count)
    lean = np.radians(LEAN) * rng.standard_normal(count)
    angles = np.stack([down, yaw, lean], axis=-1)
    tumbled = rng.random(count) < TUMBLED
    angles[tumbled] = any_turns(int(tumbled.sum()), rng)
    return angles


def any_turns(count: int, rng: np.random.Generator) -> Array:
    """Angles (N, 3) of rotations that are evenly spread over all there are."""
    axis, other = rng.standard_normal((2, count, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    other -= np.sum(other * axis, axis=-1, keepdims=True) * axis
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    rotations = np.stack([axis, other, np.cross(axis, other)], axis=-1)
    return np.array([euler_angles(rotation, np.zeros(3)) for rotation in rotations]).reshape(count, 3)


def draw_any(model: BodyModel, count: int, rng: np.random.Generator) -> Array:
    """Poses (N, D): joints evenly spread over their ranges, full turns where there is no limit."""
    low, high = model.limits.T
    whole = np.where(model.kinds == ROTATION, np.pi, 0.5)
    low, high = np.where(np.isfinite(low), low, -whole), np.where(np.isfinite(high), high, whole)
    poses = rng.uniform(low, high, size=(count, len(low)))
    poses[:, :3] = 0.0
    poses[:, 3:6] = any_turns(count, rng)
    return poses


def reach(model: BodyModel, poses: Array) -> float:
    """How far from end to end the body is at the most, metres, in any of the poses (N, D)."""
    surface = lay_vertices(model, link_transforms(model, poses[:: max(1, len(poses) // 200)]))
    return float(np.max(np.ptp(surface, axis=1)))


def look_at(model: BodyModel, poses: Array, cell: float) -> Library:
    """The signatures of poses (N, D)."""
    count = len(poses)
    images, middles = np.empty((count, ROWS, COLUMNS), dtype=np.float32), np.empty((count, 3))
    occupied = np.empty(count)
    every = stride(model)
    links, vertices = model.skin_links[::every, 0].copy(), model.vertices[::every].copy()
    sign_each(vertices, links, link_transforms(model, poses), cell, images, middles, occupied)
    cells = np.ascontiguousarray(images.reshape(count, ROWS * COLUMNS).T)
    return Library(poses, joint_positions(model, poses), middles, cells, occupied, cell, BOUND * cell)


def stride(model: BodyModel) -> int:
    """From one to the next of the vertices that are enough to fill the cells."""
    return max(1, len(model.vertices) // VERTICES)


def lay_vertices(model: BodyModel, transforms: Array) -> Array:
    """Some vertices (N, V, 3) of the surface, each moved by its main link's transform (N, L, 3, 4)."""
    every = stride(model)
    t = transforms[:, model.skin_links[::every, 0]]
    moved: Array = np.einsum("nvij,vj->nvi", t[..., :3], model.vertices[::every]) + t[..., 3]
    return moved


@numba.njit(cache=True, nogil=True)
def sign_each(
    vertices: Array,
    links: Indices,
    transforms: Array,
    cell: float,
    images: NDArray[np.float32],
    middles: Array,
    occupied: Array,
) -> None:
    """Fill images (N, ROWS, COLUMNS), middles (N, 3) and occupied (N,) of a body in each pose.

    Each of its vertices (V, 3) moves with one link of (V,), whose transforms are (N, L, 3, 4).
    """
    points = np.empty((len(vertices), 3))
    for n in range(len(images)):
        for v in range(len(vertices)):
            t = transforms[n, links[v]]
            for a in range(3):
                points[v, a] = (
                    t[a, 0] * vertices[v, 0] + t[a, 1] * vertices[v, 1] + t[a, 2] * vertices[v, 2] + t[a, 3]
                )
        occupied[n] = sign(points, cell, images[n], middles[n])
