"""An articulated body: rotations and translations about known axes, and a surface that they move.

All coordinates are those of the rest pose, in metres, in a frame whose axes agree with the camera's: x
right, y down, z forward, with the origin at the root (the pelvis). A person at rest stands upright, arms
at the sides, and faces the camera, so the person's right is -x, up is -y and the front is -z.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.errors import InputError

ROOT_DOFS = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")

TRANSLATION, ROTATION = 0, 1
LEAST_SPREAD = 1e-3

REST_FROM_URDF = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""URDF and ROS: x forward, y left, z up. Rest: x to the body's left, y down, z to its back."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Degrees of freedom (D), links (L), surface vertices (V), triangles (T) and named joints (J).

    The parent of a degree of freedom comes before it. Three successive rotations about orthonormal axes
    through one point, with nothing else on the first two, are a spherical joint; `balls` holds the index of
    the first of each. `rest_spreads` are the standard deviations of angles around rest, in units of the
    setting `pose_deviation`; they are equal for the three angles of a spherical joint. `skin_weights` blend
    the links' transforms for each vertex (rows sum to 1, the dominant link is first).
    """

    name: str
    dof_names: tuple[str, ...]  # (D,)
    kinds: Indices  # (D,) TRANSLATION or ROTATION
    parents: Indices  # (D,) -1 for none
    axes: Array  # (D, 3) unit
    points: Array  # (D, 3) on the axis
    limits: Array  # (D, 2) radians or metres, infinite where free
    rest_spreads: Array  # (D,) in units of pose_deviation
    balls: Indices  # (B,)
    link_names: tuple[str, ...]  # (L,)
    link_dofs: Indices  # (L,) the last degree of freedom that moves the link, -1 for none
    vertices: Array  # (V, 3)
    triangles: Indices  # (T, 3) counter-clockwise from outside
    skin_links: Indices  # (V, K)
    skin_weights: Array  # (V, K)
    joint_names: tuple[str, ...]  # (J,)
    joint_links: Indices  # (J,)
    joint_points: Array  # (J, 3)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                frozen = np.ascontiguousarray(value)
                shared = frozen is value and (value.flags.writeable or value.base is not None)
                frozen = frozen.copy() if shared else frozen
                frozen.setflags(write=False)
                object.__setattr__(self, field.name, frozen)
        check(self)

    @cached_property
    def hash(self) -> str:
        """SHA-256 over names, shapes and bytes of every field, in order."""
        digest = hashlib.sha256()
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                digest.update(f"{field.name}{value.dtype.str}{value.shape}".encode())
                digest.update(value.tobytes())
            else:
                digest.update(f"{field.name}{value!r}".encode())
        return digest.hexdigest()

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


def unknown_dof(name: str, known: Collection[str]) -> InputError:
    """The error for an unknown degree of freedom, with similar known names."""
    near = get_close_matches(name, known, n=3)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    return InputError(f"unknown degree of freedom '{name}'; {meant}gepf model dofs lists all")


def check(model: BodyModel) -> None:
    """Raise ValueError if a model is inconsistent."""
    count = len(model.dof_names)
    order = np.arange(count)
    if not (np.all(model.parents < order) and np.all(model.parents >= -1)):
        raise ValueError("a degree of freedom's parent must come before it")
    for name in ("kinds", "parents", "axes", "points", "limits", "rest_spreads"):
        if len(getattr(model, name)) != count:
            raise ValueError(f"{name} must have one row for each of the {count} degrees of freedom")
    if not np.all(model.rest_spreads >= LEAST_SPREAD):
        raise ValueError(f"rest_spreads must be at least {LEAST_SPREAD}")
    if np.any(
        model.rest_spreads[model.balls[:, None] + np.arange(3)] != model.rest_spreads[model.balls, None]
    ):
        raise ValueError("the three angles of a spherical joint must have the same rest_spreads")
    if len(model.link_dofs) != len(model.link_names) or np.any(model.link_dofs >= count):
        raise ValueError("every link must be moved by a degree of freedom of the model")
    if not np.allclose(np.linalg.norm(model.axes, axis=1), 1.0):
        raise ValueError("axes must be unit vectors")
    if not np.allclose(model.skin_weights.sum(axis=1), 1.0):
        raise ValueError("skin weights of a vertex must sum to 1")


def surface_carriers(link_dofs: Indices, skin_links: Indices, skin_weights: Array) -> Indices:
    """Degrees of freedom whose links have surface."""
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
    """Unit normals (V, 3), the mean of the neighbouring triangles' by area."""
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    ends, count = triangles.T.ravel(), len(vertices)
    total = np.stack([np.bincount(ends, np.tile(each, 3), count) for each in faces.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 0, total, (0.0, 1.0, 0.0))
    unit: Array = total / np.linalg.norm(total, axis=1, keepdims=True)
    return unit.astype(np.float32)
