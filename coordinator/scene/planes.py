"""Floor and walls: planes that all the rest of the picture lies above or before.

A plane is linear in the picture when depth is inverted, 1 / z = a x/z + b y/z + c, and a depth camera's
noise, which grows with z^2, is the same everywhere there. So planes are sought in (x/z, y/z, 1/z).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from common.camera import Intrinsics
from common.compiling import numba
from coordinator.scene.geometry import Array, Mask, segment_plane
from coordinator.scene.noise import DepthNoise, margin_at

SAMPLED_ACROSS = 80  # points in a row of the picture, to which planes are fitted
RANSAC_ROUNDS = 600
MOST_PLANES = 6  # that are looked at
LEAST_POINTS = 30  # on a plane
TRIPLES, NEIGHBOURS = 2_000, 400  # of points near each other, for a floor of which little is seen
LEAST_SHARE = 0.01  # of the points
MOST_BEYOND = 0.03  # share of the points that may lie behind a wall or below a floor
MOST_BELOW_SMALL = 0.005  # the same below a floor of which little is seen
MOST_SCATTER = 0.45  # margins of noise, its points' standard deviation; cut by chance they have 0.58
LEVEL = np.cos(np.radians(50.0))  # of a floor: the camera is not tilted more
UPRIGHT = np.sin(np.radians(20.0))  # of a wall at the most
LEAST_FLOOR = (0.2, 0.3)  # metres in the narrower direction, square metres
LEAST_WALL = (0.7, 1.5)
UP = np.array([0.0, -1.0, 0.0])  # of a camera that is held as usual
RIDGE = 1e-12  # of the moments' trace, for points in a line


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


NO_PLANES = Planes(np.empty((0, 3)), has_floor=False)


def sample_rays(depth_m: NDArray[np.floating], camera: Intrinsics) -> Array:
    """Points (N, 3) as x/z, y/z and 1/z, of a grid of pixels with SAMPLED_ACROSS in a row."""
    stride = max(1, camera.width // SAMPLED_ACROSS)
    v, u = np.nonzero(depth_m[::stride, ::stride])
    inverse = 1.0 / depth_m[::stride, ::stride][v, u].astype(np.float64)
    return np.stack(
        [(u * stride - camera.cx) / camera.fx, (v * stride - camera.cy) / camera.fy, inverse], axis=1
    )


def find_planes(rays: Array, noise: DepthNoise, up: Array = UP) -> Planes:
    """Floor and walls among points (N, 3) of `sample_rays`; `up` (3,) is where the sky is about."""
    found = [each for each in largest_planes(rays, noise) if beyond(each, rays, noise) < MOST_BEYOND]
    floors = [each for each in found if level(each, up) > LEVEL and is_large(each, rays, noise, LEAST_FLOOR)]
    floors = floors or small_floor(rays, noise, up)
    floor = max(floors, key=lambda each: np.count_nonzero(lie_on(each, rays, noise)), default=None)
    vertical = up if floor is None else -floor / np.linalg.norm(floor)
    upright = [each for each in found if abs(level(each, vertical)) < UPRIGHT]
    walls = [each for each in upright if is_large(each, rays, noise, LEAST_WALL)]
    chosen = walls if floor is None else [floor, *walls]
    return Planes(np.array(chosen).reshape(-1, 3), floor is not None, up)


def largest_planes(rays: Array, noise: DepthNoise) -> list[Array]:
    """Coefficients (3,) of the planes with the most points, each without the points of those before."""
    rest = rays
    found: list[Array] = []
    while len(found) < MOST_PLANES and len(rest) > max(LEAST_POINTS, LEAST_SHARE * len(rays)):
        spread = float(np.median(inverse_margin(rest, noise)))
        (a, b, c, d), _ = segment_plane(rest, spread, RANSAC_ROUNDS, seed=len(found))
        if abs(c) < np.sqrt(RIDGE):  # it holds the camera: no surface looks so
            break
        plane = refit(np.array([-a, -b, -d]) / c, rest, noise)
        on = lie_on(plane, rest, noise)
        if on.sum() < LEAST_SHARE * len(rays):
            break
        found.append(plane)
        rest = rest[~on]
    return found


def small_floor(rays: Array, noise: DepthNoise, up: Array) -> list[Array]:
    """The floor (3,) of which only patches are seen, if there is one; by RANSAC with points near each other.

    Three points (N, 3) from anywhere in the picture as good as never lie on it together.
    """
    random = np.random.default_rng(0)
    first = random.integers(len(rays), size=TRIPLES)
    near = cKDTree(rays[:, :2]).query(rays[first, :2], min(NEIGHBOURS, len(rays)))[1]
    others = np.take_along_axis(near, random.integers(near.shape[1], size=(TRIPLES, 2)), axis=1)
    triples = rays[np.column_stack([first, others])]
    flat = np.concatenate([triples[..., :2], np.ones((TRIPLES, 3, 1))], axis=-1)
    plain = np.abs(np.linalg.det(flat)) > RIDGE
    planes = np.linalg.solve(flat[plain], triples[plain, :, 2:])[..., 0]
    planes = planes[-planes @ up > LEVEL * np.linalg.norm(planes, axis=1)]
    off = (rays[:, 2] - planes[:, :2] @ rays[:, :2].T - planes[:, 2:]) / inverse_margin(rays, noise)
    on = np.count_nonzero(np.abs(off) < MOST_SCATTER, axis=1)
    on[np.mean(off < -2.0, axis=1) > MOST_BELOW_SMALL] = 0
    if not on.any():
        return []
    plane = refit(planes[on.argmax()], rays, noise)
    off = (rays[:, :2] @ plane[:2] + plane[2] - rays[:, 2]) / inverse_margin(rays, noise)
    is_surface = np.std(off[np.abs(off) < 1.0]) < MOST_SCATTER
    return (
        [plane]
        if is_surface and level(plane, up) > LEVEL and is_large(plane, rays, noise, LEAST_FLOOR)
        else []
    )


def follow_planes(planes: Planes, rays: Array, noise: DepthNoise) -> Planes:
    """The same planes as they are in the next frame of a camera that stands still or moves slowly."""
    moved = [refit(each, rays, noise) for each in planes.coefficients]
    return replace(planes, coefficients=np.array(moved).reshape(-1, 3))


def refit(plane: Array, rays: Array, noise: DepthNoise) -> Array:
    """A plane's coefficients (3,) by least squares over the points within two margins of noise, then one."""
    for margins in (2.0, 1.0):
        moments = np.zeros((3, 4))
        if add_moments(plane, rays, noise.growth, margins, moments) < LEAST_POINTS:
            return plane
        plane = np.linalg.solve(moments[:, :3] + RIDGE * np.trace(moments[:, :3]) * np.eye(3), moments[:, 3])
    return plane


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


def inverse_margin(rays: Array, noise: DepthNoise) -> Array:
    """The noise's margin (N,) in 1 / z at points (N, 3)."""
    margin: Array = noise.margin(1.0 / rays[:, 2]) * rays[:, 2] ** 2
    return margin


def lie_on(plane: Array, rays: Array, noise: DepthNoise) -> Mask:
    """Which points (N, 3) are on a plane."""
    on: Mask = np.abs(rays[:, :2] @ plane[:2] + plane[2] - rays[:, 2]) < inverse_margin(rays, noise)
    return on


def beyond(plane: Array, rays: Array, noise: DepthNoise) -> float:
    """The share of the points (N, 3) that were measured beyond a plane."""
    behind = rays[:, 2] < rays[:, :2] @ plane[:2] + plane[2] - 2.0 * inverse_margin(rays, noise)
    return float(np.mean(behind))


def level(plane: Array, up: Array) -> float:
    """Cosine between a direction and the side of a plane on which the camera is."""
    return float(-plane @ up / np.linalg.norm(plane))


def is_large(plane: Array, rays: Array, noise: DepthNoise, least: tuple[float, float]) -> bool:
    """Whether the points on a plane spread over so many metres across, and so many square metres."""
    on = rays[lie_on(plane, rays, noise)]
    if len(on) < LEAST_POINTS:
        return False
    points = np.column_stack([on[:, :2], np.ones(len(on))]) / on[:, 2:]
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2].T
    low, high = np.percentile(points @ across, EXTREMES, axis=0)
    return bool((high - low).min() > least[0] and np.prod(high - low) > least[1])


EXTREMES = (2.0, 98.0)  # per cent of the points, between which an extent is taken
