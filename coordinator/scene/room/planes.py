"""Floor and walls: planes that all the rest of the picture lies above or before.

A plane is linear in the picture when depth is inverted, 1 / z = a x/z + b y/z + c, and a depth camera's
noise, which grows with z^2, is the same everywhere there. So planes are sought in (x/z, y/z, 1/z).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.compiling import numba
from coordinator.scene.noise import DepthNoise, margin_at
from coordinator.scene.ransac import segment_plane
from coordinator.scene.room.floor import is_surface, level_plane

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 80  # points in a row of the picture, to which planes are fitted
ROUNDS = 600  # of RANSAC for each plane
MOST = 6  # planes that are looked at
SUPPORT = 0.01  # least share of the points
BEHIND = 0.03  # greatest share of the points that lie behind a wall or below the floor
TILT = np.cos(np.radians(50.0))  # of the camera against the floor at the most
UPRIGHT = np.sin(np.radians(20.0))  # of a wall at the most
FLOOR_SEEN, WALL_SEEN = (0.2, 0.3), (0.7, 1.5)  # least metres in the narrower direction, square metres
UP = np.array([0.0, -1.0, 0.0])  # of a camera that is held as usual


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Planes as (P, 3) coefficients a, b, c of 1 / z = a x/z + b y/z + c; the floor is the first.

    What lies on one of them or beyond is the room's.
    """

    coefficients: Array  # (P, 3)
    has_floor: bool
    sky: Array = field(default_factory=UP.copy)  # (3,) where it is about, for want of a floor

    @property
    def floor(self) -> Array | None:
        """The floor's coefficients (3,)."""
        return self.coefficients[0] if self.has_floor else None

    @property
    def up(self) -> Array:
        """Away from the floor (3,), in the camera frame; to where the sky is about without one."""
        floor = self.floor
        return self.sky if floor is None else -floor / np.linalg.norm(floor)

    @property
    def camera_height(self) -> float | None:
        """Of the camera over the floor, metres; None without a floor."""
        floor = self.floor
        return None if floor is None else float(1.0 / np.linalg.norm(floor))

    def above(self, points: Array) -> Array:
        """Heights (...) of points (..., 3) over the floor; over the camera's own height without one."""
        heights: Array = points @ self.up + (self.camera_height or 0.0)
        return heights


NONE = Planes(np.empty((0, 3)), has_floor=False)


def sample(depth_m: NDArray[np.floating], camera: Intrinsics, stride: int | None = None) -> Array:
    """Points (N, 3) as x/z, y/z and 1/z, of a grid of pixels, so many apart; ACROSS in a row if None."""
    stride = stride or max(1, camera.width // ACROSS)
    v, u = np.nonzero(depth_m[::stride, ::stride])
    inverse = 1.0 / depth_m[::stride, ::stride][v, u].astype(np.float64)
    return np.stack(
        [(u * stride - camera.cx) / camera.fx, (v * stride - camera.cy) / camera.fy, inverse], axis=1
    )


def find_planes(rays: Array, noise: DepthNoise, up: Array = UP) -> Planes:
    """Floor and walls among points (N, 3) of `sample`; `up` (3,) is where the sky is about."""
    found = [each for each in largest_planes(rays, noise) if is_border(each, rays, noise)]
    floors = [each for each in found if level(each, up) > TILT and is_large(each, rays, noise, FLOOR_SEEN)]
    floors = floors or small_floors(rays, noise, up)
    floor = max(floors, key=lambda each: support(each, rays, noise), default=None)
    vertical = up if floor is None else -floor / np.linalg.norm(floor)
    upright = [each for each in found if abs(level(each, vertical)) < UPRIGHT]
    walls = [each for each in upright if is_large(each, rays, noise, WALL_SEEN)]
    chosen = walls if floor is None else [floor, *walls]
    return Planes(np.array(chosen).reshape(-1, 3), floor is not None, up)


def small_floors(rays: Array, noise: DepthNoise, up: Array) -> list[Array]:
    """The floor of which only patches are seen, if there is one that is a surface in earnest."""
    plane = level_plane(rays, noise, up, TILT)
    if not plane.any():
        return []
    plane = refit(plane, rays, noise)
    return [plane] if level(plane, up) > TILT and is_surface(plane, rays, noise) else []


def largest_planes(rays: Array, noise: DepthNoise) -> list[Array]:
    """Coefficients (3,) of the planes with the most points, each without the points of those before."""
    rest = rays
    found: list[Array] = []
    while len(found) < MOST and len(rest) > max(50, SUPPORT * len(rays)):
        spread = float(np.median(inverse_margin(rest, noise)))
        (a, b, c, d), _ = segment_plane(rest, spread, ROUNDS, seed=len(found))
        if abs(c) < STEEPEST:  # it holds the camera: no surface looks so
            break
        plane = refit(np.array([-a, -b, -d]) / c, rest, noise)
        on = np.abs(plane_inverse(plane, rest) - rest[:, 2]) < inverse_margin(rest, noise)
        if on.sum() < SUPPORT * len(rays):
            break
        found.append(plane)
        rest = rest[~on]
    return found


STEEPEST = 1e-3


def refit(plane: Array, rays: Array, noise: DepthNoise, margins: tuple[float, ...] = (2.0, 1.0)) -> Array:
    """A plane's coefficients (3,) by least squares over the points on it, within so many margins of noise."""
    for within in margins:
        moments = np.zeros((3, 4))
        if add_moments(plane, rays, noise.growth, within, moments) < LEAST_POINTS:
            return plane
        plane = np.linalg.solve(moments[:, :3] + RIDGE * np.trace(moments[:, :3]) * np.eye(3), moments[:, 3])
    return plane


RIDGE = 1e-12


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_moments(plane: Array, rays: Array, growth: float, within: float, moments: Array) -> int:
    """Add to moments (3, 4) x x^T and x / z of x = (x/z, y/z, 1), for the points (N, 3) that are on a plane.

    They are on it within so many margins of the noise; gives how many they are.
    """
    count = 0
    x = np.ones(3)
    for n in range(len(rays)):
        inverse = rays[n, 2]
        z = 1.0 / inverse
        margin = margin_at(z, growth) * inverse * inverse
        x[0], x[1] = rays[n, 0], rays[n, 1]
        if abs(plane[0] * x[0] + plane[1] * x[1] + plane[2] - inverse) < within * margin:
            count += 1
            weight = 1.0 / (margin * margin)
            for i in range(3):
                for j in range(3):
                    moments[i, j] += weight * x[i] * x[j]
                moments[i, 3] += weight * x[i] * inverse
    return count


LEAST_POINTS = 30


def follow_planes(planes: Planes, rays: Array, noise: DepthNoise) -> Planes:
    """The same planes as they are in the next frame of a camera that stands still or moves slowly."""
    moved = [refit(each, rays, noise) for each in planes.coefficients]
    return replace(planes, coefficients=np.array(moved).reshape(-1, 3))


def plane_inverse(plane: Array, rays: Array) -> Array:
    """1 / z (N,) of a plane on the lines of sight of points (N, 3)."""
    inverse: Array = rays[:, :2] @ plane[:2] + plane[2]
    return inverse


def inverse_margin(rays: Array, noise: DepthNoise) -> Array:
    """The noise's margin (N,) in 1 / z at points (N, 3)."""
    z = 1.0 / rays[:, 2]
    return np.asarray(noise.margin(z), dtype=np.float64) / (z * z)


def support(plane: Array, rays: Array, noise: DepthNoise) -> int:
    """How many points are on a plane."""
    return int(np.sum(np.abs(plane_inverse(plane, rays) - rays[:, 2]) < inverse_margin(rays, noise)))


def is_border(plane: Array, rays: Array, noise: DepthNoise) -> bool:
    """Whether next to nothing was measured beyond a plane."""
    beyond = rays[:, 2] < plane_inverse(plane, rays) - 2.0 * inverse_margin(rays, noise)
    return float(np.mean(beyond)) < BEHIND


def level(plane: Array, up: Array) -> float:
    """Cosine between a direction and the side of a plane on which the camera is."""
    return float(-plane @ up / np.linalg.norm(plane))


def is_large(plane: Array, rays: Array, noise: DepthNoise, least: tuple[float, float]) -> bool:
    """Whether the points on a plane spread over so many metres across, and so many square metres."""
    on = np.abs(plane_inverse(plane, rays) - rays[:, 2]) < inverse_margin(rays, noise)
    if on.sum() < LEAST_POINTS:
        return False
    z = 1.0 / rays[on, 2]
    points = np.column_stack([rays[on, 0] * z, rays[on, 1] * z, z])
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2].T
    low, high = np.percentile(points @ across, [2.0, 98.0], axis=0)
    return bool((high - low).min() > least[0] and np.prod(high - low) > least[1])
