"""An articulated body: rotations and translations about known axes, and a surface that they move.

All coordinates are those of the rest pose, in metres, in a frame whose axes agree with the camera's: x
right, y down, z forward, with the origin at the root (the pelvis). A person at rest stands upright, arms
at the sides, and faces the camera, so the person's right is -x, up is -y and the front is -z.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.errors import InputError

ROOT_DOFS = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")

TRANSLATION, ROTATION, SHAPE = 0, 1, 2
"""Kinds of degrees of freedom. A shape coefficient, in metres, changes the rest pose."""

LEAST_SPREAD = 1e-3

MECHANISM = "mechanism"
"""The family of robots and objects: rigid links of known shape."""

REST_FROM_URDF = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""URDF and ROS: x forward, y left, z up. Rest: x to the body's left, y down, z to its back."""


KEYPOINTS = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
"""Points of a person that networks detect in an image, in the order of the COCO data set."""

NO_KEYPOINTS = np.empty((0, 1), np.int64)
"""Indices of keypoints, for a body that is not a person."""

NO_DIRECTIONS = np.empty((0, 0, 3))
"""Shape directions, for a body whose shape cannot change."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Degrees of freedom (D), links (L), surface vertices (V), triangles (T) and named joints (J).

    The parent of a degree of freedom comes before it. Three successive rotations about orthonormal axes
    through one point, with nothing else on the first two, are a spherical joint; `balls` holds the index of
    the first of each. `rest_spreads` are the standard deviations of angles around rest, in units of the
    setting `pose_deviation`; they are equal for the three angles of a spherical joint. Those of shape
    coefficients, in metres, are around the detected shape. `skin_weights` blend the links' transforms for
    each vertex (rows sum to 1, the dominant link is first).

    The keypoints (K) are KEYPOINTS or none. Each is a point of a link: the sum of vertices at rest, times
    shares that add up to 1.

    Shape coefficients (S) are the first degrees of freedom. The rest pose of a body with coefficients b is
    `vertices` + b . `shape_vertices`; `points` and `joint_points` change likewise.

    `family` names what else is known of such bodies, see `gepf.coordinator.bodies.family`; workers ignore it.
    """

    name: str
    dof_names: tuple[str, ...]  #: (D,)
    kinds: Indices  #: (D,) SHAPE, TRANSLATION or ROTATION
    parents: Indices  #: (D,) -1 for none
    axes: Array  #: (D, 3) unit
    points: Array  #: (D, 3) on the axis
    limits: Array  #: (D, 2) radians or metres, infinite where free
    rest_spreads: Array  #: (D,) in units of pose_deviation
    balls: Indices  #: (B,)
    link_names: tuple[str, ...]  #: (L,)
    link_dofs: Indices  #: (L,) the last degree of freedom that moves the link, -1 for none
    vertices: Array  #: (V, 3)
    triangles: Indices  #: (T, 3) counter-clockwise from outside
    skin_links: Indices  #: (V, K)
    skin_weights: Array  #: (V, K)
    joint_names: tuple[str, ...]  #: (J,)
    joint_links: Indices  #: (J,)
    joint_points: Array  #: (J, 3)
    keypoint_links: Indices = field(default_factory=lambda: NO_KEYPOINTS[:, 0])  #: (K,)
    keypoint_vertices: Indices = field(default_factory=lambda: NO_KEYPOINTS)  #: (K, W)
    keypoint_shares: Array = field(default_factory=lambda: NO_KEYPOINTS.astype(np.float64))  #: (K, W)
    shape_vertices: Array = field(
        default_factory=lambda: NO_DIRECTIONS
    )  # (S, V, 3) per unit of the shape coefficient
    shape_points: Array = field(default_factory=lambda: NO_DIRECTIONS)  #: (S, D, 3)
    shape_joint_points: Array = field(default_factory=lambda: NO_DIRECTIONS)  #: (S, J, 3)
    family: str = MECHANISM

    def __post_init__(self) -> None:
        for member in fields(self):
            value = getattr(self, member.name)
            if member.name.startswith("shape_") and not len(value):
                value = np.empty((0, *getattr(self, member.name.removeprefix("shape_")).shape))
            if isinstance(value, np.ndarray):
                frozen = np.ascontiguousarray(value)
                shared = frozen is value and (value.flags.writeable or value.base is not None)
                frozen = frozen.copy() if shared else frozen
                frozen.setflags(write=False)
                object.__setattr__(self, member.name, frozen)
        check(self)

    @cached_property
    def hash(self) -> str:
        """SHA-256 over names, shapes and bytes of every field, in order."""
        digest = hashlib.sha256()
        for member in fields(self):
            value = getattr(self, member.name)
            if isinstance(value, np.ndarray):
                digest.update(f"{member.name}{value.dtype.str}{value.shape}".encode())
                digest.update(value.tobytes())
            else:
                digest.update(f"{member.name}{value!r}".encode())
        return digest.hexdigest()

    @property
    def shape_count(self) -> int:
        """The number S of shape coefficients."""
        return len(self.shape_vertices)

    @property
    def keypoint_points(self) -> Array:
        """The keypoints (K, 3) at rest, with all shape coefficients zero."""
        return np.asarray(
            np.einsum("kw,kwa->ka", self.keypoint_shares, self.vertices[self.keypoint_vertices])
        )

    @cached_property
    def moves(self) -> Mask:
        """Which degrees of freedom (D,) change with time, that is, all but shape coefficients."""
        return np.asarray(self.kinds != SHAPE)

    @cached_property
    def root(self) -> Indices:
        """Indices (6,) of the root's degrees of freedom: three translations, three rotations.

        InputError if some of them are held.
        """
        return np.array([self.dof(name) for name in ROOT_DOFS], dtype=np.int64)

    @cached_property
    def related(self) -> Mask:
        """Which pairs (D, D) of degrees of freedom move a common link: each with itself and its ancestors."""
        related = np.eye(len(self.parents), dtype=np.bool_)
        for j, parent in enumerate(self.parents):
            related[j] |= related[parent] & (parent >= 0)
        return related | related.T

    @cached_property
    def single(self) -> Mask:
        """Which degrees of freedom (D,) are not part of a spherical joint."""
        single = np.ones(len(self.kinds), dtype=np.bool_)
        single[self.balls[:, None] + np.arange(3)] = False
        single.setflags(write=False)
        return single

    def joints_of(self, kind: int) -> tuple[str, ...]:
        """Degrees of freedom of a kind, ROTATION or TRANSLATION, without the root."""
        kinds = zip(self.dof_names, self.kinds, strict=True)
        return tuple(name for name, each in kinds if each == kind and name not in ROOT_DOFS)

    def dof(self, name: str) -> int:
        """Index of a degree of freedom; InputError if the name is unknown."""
        if name not in self.dof_names:
            raise unknown_dof(name, self.dof_names)
        return self.dof_names.index(name)


def with_shape(
    model: BodyModel,
    names: tuple[str, ...],
    deviations: Array,
    vertices: Array,
    points: Array,
    joint_points: Array,
) -> BodyModel:
    """Add shape coefficients with these names (S) to the degrees of freedom of a body of fixed shape.

    Coefficients of zero give the fixed shape; `deviations` (S,) are their standard deviations. The arrays
    (S, V, 3), (S, D, 3) and (S, J, 3) are the change of the rest pose per unit of each coefficient.
    """
    count = len(names)
    zero = np.zeros((count, 3))
    return replace(
        model,
        dof_names=names + model.dof_names,
        kinds=np.concatenate([np.full(count, SHAPE), model.kinds]),
        parents=np.concatenate([np.arange(-1, count - 1), model.parents + count]),
        axes=np.concatenate([zero + np.eye(3)[0], model.axes]),
        points=np.concatenate([zero, model.points]),
        limits=np.concatenate([np.tile([-np.inf, np.inf], (count, 1)), model.limits]),
        rest_spreads=np.concatenate([deviations, model.rest_spreads]),
        balls=model.balls + count,
        link_dofs=model.link_dofs + count,
        shape_vertices=vertices,
        shape_points=np.concatenate([np.zeros((count, count, 3)), points], axis=1),
        shape_joint_points=joint_points,
    )


@lru_cache(maxsize=16)
def at_zero_shape(model: BodyModel) -> BodyModel:
    """The body fixed in the shape where all shape coefficients are zero: for its names, and as an example."""
    return with_fixed_shape(model, np.zeros(model.shape_count))


def with_fixed_shape(model: BodyModel, shape: Array) -> BodyModel:
    """The body with its shape coefficients fixed at values (S,); the body itself if it has none."""
    count = model.shape_count
    if not count:
        return model
    return replace(
        model,
        dof_names=model.dof_names[count:],
        kinds=model.kinds[count:],
        parents=np.maximum(model.parents[count:] - count, -1),
        axes=model.axes[count:],
        points=(model.points + np.tensordot(shape, model.shape_points, axes=1))[count:],
        limits=model.limits[count:],
        rest_spreads=model.rest_spreads[count:],
        balls=model.balls - count,
        link_dofs=np.maximum(model.link_dofs - count, -1),
        vertices=model.vertices + np.tensordot(shape, model.shape_vertices, axes=1),
        joint_points=model.joint_points + np.tensordot(shape, model.shape_joint_points, axes=1),
        shape_vertices=NO_DIRECTIONS,
        shape_points=NO_DIRECTIONS,
        shape_joint_points=NO_DIRECTIONS,
    )


def unknown_dof(name: str, known: Collection[str]) -> InputError:
    """The error for an unknown degree of freedom, with similar known names."""
    near = get_close_matches(name, known, n=3)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    return InputError(f"unknown degree of freedom '{name}'; {meant}gepf model dofs lists all")


def check(model: BodyModel) -> None:
    """Raise ValueError if a model is inconsistent."""
    count = len(model.dof_names)
    order = np.arange(count)
    check_shape(model)
    check_keypoints(model)
    if not (np.all(model.parents < order) and np.all(model.parents >= -1)):
        raise ValueError("a degree of freedom's parent must come before it")
    for name in ("kinds", "parents", "axes", "points", "limits", "rest_spreads"):
        if len(getattr(model, name)) != count:
            raise ValueError(f"{name} must have one row for each of the {count} degrees of freedom")
    spreads = model.rest_spreads
    if not np.all(spreads >= LEAST_SPREAD):
        raise ValueError(f"rest_spreads must be at least {LEAST_SPREAD}")
    if np.any(spreads[model.balls[:, None] + np.arange(3)] != spreads[model.balls, None]):
        raise ValueError("the three angles of a spherical joint must have the same rest_spreads")
    if len(model.link_dofs) != len(model.link_names) or np.any(model.link_dofs >= count):
        raise ValueError("every link must be moved by a degree of freedom of the model")
    if not np.allclose(np.linalg.norm(model.axes, axis=1), 1.0):
        raise ValueError("axes must be unit vectors")
    if not np.allclose(model.skin_weights.sum(axis=1), 1.0):
        raise ValueError("skin weights of a vertex must sum to 1")


def check_keypoints(model: BodyModel) -> None:
    """Raise ValueError if the keypoints of a model are inconsistent."""
    count = len(model.keypoint_links)
    if count not in (0, len(KEYPOINTS)):
        raise ValueError(f"a body has {len(KEYPOINTS)} keypoints or none, not {count}")
    if model.keypoint_vertices.shape != model.keypoint_shares.shape or len(model.keypoint_shares) != count:
        raise ValueError("keypoint_vertices and keypoint_shares must have a row for each keypoint")
    if not np.allclose(model.keypoint_shares.sum(axis=1), 1.0):
        raise ValueError("the shares of a keypoint must sum to 1")


def check_shape(model: BodyModel) -> None:
    """Raise ValueError if the shape coefficients of a model are inconsistent."""
    count = model.shape_count
    if np.any((model.kinds == SHAPE) != (np.arange(len(model.kinds)) < count)):
        raise ValueError(f"the first {count} degrees of freedom, and no others, must be shape coefficients")
    for name in ("vertices", "points", "joint_points"):
        if getattr(model, f"shape_{name}").shape != (count, *getattr(model, name).shape):
            raise ValueError(f"shape_{name} must hold {name} for each shape coefficient")


def surface_carriers(link_dofs: Indices, skin_links: Indices, skin_weights: Array) -> Indices:
    """The degrees of freedom whose links carry a part of the surface."""
    return np.unique(link_dofs[skin_links[skin_weights > 0.0]])


def find_balls(kinds: Indices, parents: Indices, axes: Array, points: Array, carriers: Indices) -> Indices:
    """First index of every three successive rotations about orthonormal axes through one point.

    They are one joint only if the first two move nothing but the next: no surface (of `carriers`, see
    `surface_carriers`) and no other degree of freedom.
    """
    children = np.bincount(parents[parents >= 0], minlength=len(kinds))
    bare = (children == 1) & ~np.isin(np.arange(len(kinds)), carriers)
    balls, j = [], 0
    while j + 2 < len(kinds):
        triple = slice(j, j + 3)
        chained = parents[j + 1] == j and parents[j + 2] == j + 1
        if chained and bare[j : j + 2].all() and np.all(kinds[triple] == ROTATION):
            orthonormal = np.allclose(axes[triple] @ axes[triple].T, np.eye(3), atol=1e-9)
            if orthonormal and np.allclose(points[triple], points[j], atol=1e-9):
                balls.append(j)
                j += 2
        j += 1
    return np.array(balls, dtype=np.int64)


def vertex_normals(vertices: Array, triangles: Indices) -> NDArray[np.float32]:
    """Unit normals (V, 3): area-weighted means of the normals of the neighbouring triangles."""
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    ends, count = triangles.T.ravel(), len(vertices)
    total = np.stack([np.bincount(ends, np.tile(each, 3), count) for each in faces.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 0, total, (0.0, 1.0, 0.0))
    unit: Array = total / np.linalg.norm(total, axis=1, keepdims=True)
    return unit.astype(np.float32)
