"""Furniture from convex parts, in the room's frame: x right, y down, z away; the floor is y = 0.

A person faces -z. Heights are metres above the floor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from gepf.common.arrays import Array, Indices

Range = tuple[float, float]
Surface = tuple[Array, Indices]
"""Vertices (V, 3) and triangles (T, 3), counter-clockwise from outside."""

CORNERS = 24  # of a wheel
THICK_M = 0.035  # legs, posts, slats, rims


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A convex solid: vertices (V, 3) and triangles (T, 3), counter-clockwise from outside."""

    vertices: Array
    triangles: Indices

    @classmethod
    def around(cls, points: Array) -> Part:
        """The convex hull of points (n, 3)."""
        hull = trimesh.convex.convex_hull(points)
        return cls(np.asarray(hull.vertices), np.asarray(hull.faces))

    def depth_of(self, points: Array) -> Array:
        """How deep points (n, 3) are inside, metres; 0 outside."""
        corners = self.vertices[self.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        outside = points @ normals.T - np.sum(normals * corners[:, 0], axis=1)
        return np.asarray(np.maximum(0.0, -outside.max(axis=1)))


def block(x: Range, z: Range, height: Range) -> Part:
    """An upright box."""
    ends = ((x, (-height[1], -height[0]), z)[axis] for axis in range(3))
    return Part.around(np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 3))


def post(x: float, z: float, height: Range) -> Part:
    """A thin upright."""
    half = 0.5 * THICK_M
    return block((x - half, x + half), (z - half, z + half), height)


def legs(x: Range, z: Range, top: float) -> Iterator[Part]:
    """A leg at each corner."""
    half = 0.5 * THICK_M
    return (post(a, b, (0.0, top)) for a in (x[0] + half, x[1] - half) for b in (z[0] + half, z[1] - half))


def circle(radius: float) -> Array:
    """Points (n, 2) of a circle, as z and y."""
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def disc(x: Range, z: float, height: float, radius: float) -> Part:
    """A solid wheel that rolls along z; `height` is that of its axle."""
    return Part.around(wheel_points(x, z, height, circle(radius)))


def rim(x: Range, z: float, height: float, radius: float) -> Iterator[Part]:
    """A wheel without spokes."""
    outer, inner = circle(radius), circle(radius - THICK_M)
    for a in range(CORNERS):
        b = (a + 1) % CORNERS
        yield Part.around(wheel_points(x, z, height, np.array([outer[a], outer[b], inner[a], inner[b]])))


def wheel_points(x: Range, z: float, height: float, across: Array) -> Array:
    """Both sides (2 n, 3) of a prism along x."""
    return np.array([(side, b - height, z + a) for side in x for a, b in across])


def joined(parts: Sequence[Part]) -> Surface:
    """All parts as one surface."""
    vertices, triangles = trimesh.util.append_faces(
        [part.vertices for part in parts], [part.triangles for part in parts]
    )
    return np.asarray(vertices), np.asarray(triangles)


def room(half: Sequence[float], ceiling: float) -> Surface:
    """Floor, ceiling and four walls, seen from inside; `half` are the distances of -x, +x, -z and +z."""
    walls = block((-half[0], half[1]), (-half[2], half[3]), (0.0, ceiling))
    return walls.vertices, walls.triangles[:, ::-1]


def deepest(parts: Sequence[Part], points: Array) -> float:
    """How deep the deepest of the points (..., 3) is inside any part, metres."""
    flat = points.reshape(-1, 3)
    return max((float(part.depth_of(flat).max()) for part in parts), default=0.0)
