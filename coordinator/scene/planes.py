"""Planes: floor and walls, which are behind everything else in the image.

The inverse depth of a plane is linear in the image: 1 / z = a x/z + b y/z + c. So planes are fitted to rays
(N, 4): x/z, y/z, 1/z, and the tolerance of 1/z, due to noise, within which a ray counts as lying on a plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import Intrinsics, level_from_camera
from gepf.common.compiling import numba
from gepf.coordinator.scene.noise import DepthNoise
from gepf.coordinator.settings import PlaneSettings

UP_DIRECTIONS = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""Up in an upright image, and in one that is rotated by a multiple of 90 degrees; camera frame."""


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes as (P, 3) coefficients a, b, c of 1 / z = a x/z + b y/z + c; the floor is the first.

    Points on a plane or beyond it belong to the room. `approximate_up` (3,) is a unit vector.
    """

    coefficients: Array = field(default_factory=lambda: np.empty((0, 3)))
    has_floor: bool = False
    approximate_up: Array = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))

    @cached_property
    def level(self) -> Array:
        """The rotation (3, 3) from the camera frame to that of the levelled camera: x right, y down."""
        return level_from_camera(self.up)

    @property
    def up(self) -> Array:
        """Unit vector (3,) away from the floor, camera frame; without a floor, `approximate_up`."""
        return -self.coefficients[0] * self.camera_height if self.has_floor else self.approximate_up

    @property
    def camera_height(self) -> float:
        """Height of the camera above the floor, metres; 0 without a floor."""
        return float(1.0 / np.linalg.norm(self.coefficients[0])) if self.has_floor else 0.0

    def above(self, points: Array) -> Array:
        """Heights (...) of points (..., 3) above the floor; without a floor, above the camera."""
        return np.asarray(points @ self.up + self.camera_height)


def sample_rays(
    depth_m: NDArray[np.floating], camera: Intrinsics, noise: DepthNoise, points_across: int
) -> Array:
    """Rays (N, 4) of a grid of `points_across` pixels per row, with tolerances from this noise."""
    stride = max(1, camera.width // points_across)
    v, u = np.nonzero(depth_m[::stride, ::stride])
    z = depth_m[::stride, ::stride][v, u].astype(np.float64)
    x, y = (u * stride - camera.cx) / camera.fx, (v * stride - camera.cy) / camera.fy
    return to_rays(np.stack([x * z, y * z, z], axis=1), noise)


def to_rays(points: Array, noise: DepthNoise) -> Array:
    """Rays (N, 4) of points (N, 3), metres, with this noise."""
    z = points[:, 2:]
    return np.hstack([points[:, :2] / z, 1.0 / z, noise.margin(z) / (z * z)])


def to_points(rays: Array) -> Array:
    """Points (N, 3) of rays (N, 4), metres."""
    return np.column_stack([rays[:, :2], np.ones(len(rays))]) / rays[:, 2:3]


def extents(points: Array, outlier_percent: float) -> Array:
    """Extents (K,) of points (N, K) in each coordinate, after discarding `outlier_percent` at each end."""
    low, high = np.percentile(points, (outlier_percent, 100.0 - outlier_percent), axis=0)
    return np.asarray(high - low)


def find_planes(rays: Array, approximate_ups: Array, settings: PlaneSettings) -> Planes:
    """Floor and walls among rays (N, 4), by RANSAC, given the possible approximate up directions (K, 3).

    If several directions are possible, up is the one on whose floor most things rest; if no direction has a
    floor, the first one.
    """
    drawn, rest, planes = draw_planes(rays, settings.samples), rays, list[Array]()
    max_beyond = settings.max_beyond_share * len(rays)
    drawn = drawn[count_rays(drawn, rays)[:, 2] <= max_beyond]
    while len(drawn):
        refined = refine_best(drawn, support(drawn, rest), rest, settings)
        score = support(refined, rest)
        score[count_rays(refined, rays)[:, 2] > max_beyond] = 0
        if score.max() < settings.min_points:
            break
        planes.append(refined[score.argmax()])
        rest = rest[~lie_on(planes[-1], rest)]
    min_floor = settings.min_floor_width_m, settings.min_floor_area_m2
    large = [plane for plane in planes if is_large(plane, rays, min_floor, settings.outlier_percent)]
    approximate_up, floor = choose_floor(large, rays, approximate_ups, settings)
    up = approximate_up if floor is None else -floor / np.linalg.norm(floor)
    min_wall, max_tilt = (settings.min_wall_width_m, settings.min_wall_area_m2), settings.max_wall_tilt_deg
    walls = [
        plane
        for plane in planes
        if abs(cosine_to(plane, up)) < np.sin(np.radians(max_tilt))
        and is_large(plane, rays, min_wall, settings.outlier_percent)
    ]
    chosen = walls if floor is None else [floor, *walls]
    return Planes(np.array(chosen).reshape(-1, 3), floor is not None, approximate_up)


def choose_floor(
    planes: Sequence[Array], rays: Array, approximate_ups: Array, settings: PlaneSettings
) -> tuple[Array, Array | None]:
    """The approximate up direction (3,), of the possible ones (K, 3), and the floor among large planes.

    Furniture and people stand on a floor, so they are more often near it than near a wall or a ceiling.
    """
    min_level = np.cos(np.radians(settings.max_camera_tilt_deg))
    floors = [
        max(
            (plane for plane in planes if cosine_to(plane, up) > min_level),
            key=lambda plane: np.count_nonzero(lie_on(plane, rays)),
            default=None,
        )
        for up in approximate_ups
    ]
    things = rays
    for plane in planes:
        things = things[~lie_on(plane, things)]
    points = to_points(things)
    resting = np.zeros(len(floors))
    for n, floor in enumerate(floors):
        if floor is not None and len(points):
            heights = (1.0 - points @ floor) / np.linalg.norm(floor)
            resting[n] = np.mean(np.exp(-np.maximum(heights, 0.0) / settings.resting_height_m))
    if floors[0] is None:
        # another direction needs at least this share on its floor
        resting[0] = settings.min_resting_share
    best = int(resting.argmax())
    return approximate_ups[best], floors[best]


def support(planes: Array, rays: Array) -> Indices:
    """Number of rays (N, 4) in the inner half of each plane's margin, minus those in its outer half."""
    counts = count_rays(planes, rays)
    return np.asarray(2 * counts[:, 0] - counts[:, 1])


def cosine_to(plane: Array, up: Array) -> float:
    """Cosine between a direction (3,) and the normal of a plane towards the camera."""
    return float(-plane @ up / np.linalg.norm(plane))


def refine_best(planes: Array, scores: Indices, rays: Array, settings: PlaneSettings) -> Array:
    """The planes of (M, 3) with the largest scores (M,), each refitted to the rays (N, 4) on it."""
    best = planes[np.argsort(-scores, kind="stable")[: settings.refined_samples]]
    return refit(refit(best, rays, settings.min_points), rays, settings.min_points)


def draw_planes(rays: Array, count: int) -> Array:
    """Coefficients (M, 3) of at most `count` planes through three of the rays (N, 4) each.

    The distances between the three range from small to large: if only patches of a floor are visible, three
    random rays are rarely all on it.
    """
    rng = np.random.default_rng(0)
    tree = cKDTree(rays[:, :2])
    first = rays[rng.integers(len(rays), size=count)]
    apart = 0.5 * rng.uniform(size=(count, 1)) ** 2 * np.ptp(rays[:, :2], axis=0)
    second, third = (
        rays[tree.query(first[:, :2] + apart * rng.normal(size=apart.shape))[1], :3] - first[:, :3]
        for _ in range(2)
    )
    normal = np.cross(second, third)
    is_visible = np.abs(normal[:, 2]) > np.finfo(float).eps  # not if the plane contains the camera
    normal, first = normal[is_visible], first[is_visible]
    slopes = -normal[:, :2] / normal[:, 2:]
    return np.column_stack([slopes, first[:, 2] - np.sum(slopes * first[:, :2], axis=1)])


@numba.njit(cache=True, nogil=True)
def count_rays(planes: Array, rays: Array) -> Indices:
    """Numbers (M, 3) of rays (N, 4) near each plane.

    They are those within half a margin of the plane, those within one margin, and those more than two margins
    behind it.
    """
    counts = np.empty((len(planes), 3), dtype=np.int64)
    x, y, inverse = rays[:, 0] / rays[:, 3], rays[:, 1] / rays[:, 3], rays[:, 2] / rays[:, 3]
    weight = 1.0 / rays[:, 3]
    for m in range(len(planes)):
        a, b, c = planes[m]
        near, within, beyond = 0, 0, 0
        for n in range(len(x)):
            off = inverse[n] - a * x[n] - b * y[n] - c * weight[n]  # in margins
            near += abs(off) < 0.5
            within += abs(off) < 1.0
            beyond += off < -2.0
        counts[m] = near, within, beyond
    return counts


def refit(planes: Array, rays: Array, min_points: int) -> Array:
    """Fit planes (M, 3) by least squares to the rays (N, 4) within the margin, then within half of it.

    A plane with fewer rays than `min_points` stays as it is.
    """
    planes = planes.copy()
    for margins in (1.0, 0.5):
        moments, counts = sum_moments(planes, rays, margins)
        enough = counts >= min_points
        products, sums = moments[enough, :, :3], moments[enough, :, 3:]
        rounding = np.finfo(float).eps * counts[enough]
        ridge = rounding * np.trace(products, axis1=1, axis2=2)  # for collinear points
        planes[enough] = np.linalg.solve(products + ridge[:, None, None] * np.eye(3), sums)[..., 0]
    return planes


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sum_moments(planes: Array, rays: Array, within: float) -> tuple[Array, Indices]:
    """Sums (M, 3, 4) of v v^T and v / z, with v = (x/z, y/z, 1), over the rays (N, 4) on each plane (M, 3).

    A ray is on a plane if it is `within` this multiple of its margin, and has the weight 1 / margin^2. Also
    returns the numbers (M,) of these rays.
    """
    moments, counts = np.zeros((len(planes), 3, 4)), np.zeros(len(planes), dtype=np.int64)
    v = np.ones(3)
    for m in range(len(planes)):
        a, b, c = planes[m]
        for n in range(len(rays)):
            across, down, inverse, margin = rays[n]
            if abs(a * across + b * down + c - inverse) < within * margin:
                v[0], v[1] = across, down
                counts[m] += 1
                weight = 1.0 / (margin * margin)
                for i in range(3):
                    for j in range(3):
                        moments[m, i, j] += weight * v[i] * v[j]
                    moments[m, i, 3] += weight * v[i] * inverse
    return moments, counts


def lie_on(plane: Array, rays: Array) -> Mask:
    """Which rays (N, 4) are on a plane."""
    return np.asarray(np.abs(rays[:, :2] @ plane[:2] + plane[2] - rays[:, 2]) < rays[:, 3])


def is_large(plane: Array, rays: Array, min_size: tuple[float, float], outlier_percent: float) -> bool:
    """Whether the rays (N, 4) on a plane extend over at least this width, metres, and area, square metres.

    `outlier_percent` of them are discarded at each end.
    """
    points = to_points(rays[lie_on(plane, rays)])
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2].T
    extent = extents(points @ across, outlier_percent)
    return bool(extent.min() > min_size[0] and np.prod(extent) > min_size[1])
