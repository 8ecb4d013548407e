"""A floor of which little is seen: between furniture, or as a strip before a table.

Three points anywhere in the picture as good as never lie on it together. So they are taken near each other:
of the planes through them that are about level and have nothing below them, the one with the most points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.noise import DepthNoise, margin_at

Array = NDArray[np.float64]

BELOW = 0.005  # greatest share of the points that lie below it
COVERED = 0.5  # least square metres of it that are seen
SCATTER = (
    0.45  # greatest deviation of its points in margins of noise; those that a plane cuts by chance: 0.58
)
TIGHT = 0.6  # margins of noise within which a point counts for a plane: most of a surface's
TRIPLES = 4_000
ASIDE, ABOVE = 0.25, 0.12  # greatest differences of x/z and of y/z between the points of a triple
TRIES = 60  # to find the next point of a triple
SEED = 0


def level_plane(rays: Array, noise: DepthNoise, up: Array, least_level: float) -> Array:
    """Coefficients (3,) of the plane with the most points (N, 3) that is a floor; zeros if there is none.

    Args:
        rays: Points as x/z, y/z and 1/z.
        noise: Of their depth.
        up: Where the sky is about (3,).
        least_level: Least cosine between `up` and the plane's upper side.
    """
    draws = np.random.default_rng(SEED).integers(len(rays), size=(TRIPLES, 1 + 2 * TRIES))
    plane = np.zeros(3)
    best_level(rays, draws, noise.growth, up, least_level, BELOW * len(rays), plane)
    return plane


def is_surface(plane: Array, rays: Array, noise: DepthNoise) -> bool:
    """Whether points (N, 3) of a grid of rays lie on a plane as on a surface, and cover enough of it."""
    z = 1.0 / rays[:, 2]
    off = (rays[:, :2] @ plane[:2] + plane[2] - rays[:, 2]) * z * z / noise.margin(z)
    on = np.abs(off) < 1.0
    cell = np.prod([np.diff(np.unique(rays[:, axis])).min() for axis in (0, 1)])
    covered = float(np.sum(z[on] ** 3)) * float(np.linalg.norm(plane)) * cell
    return bool(covered > COVERED and off[on].std() < SCATTER)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def best_level(
    rays: Array,
    draws: NDArray[np.int64],
    growth: float,
    up: Array,
    least_level: float,
    most_below: float,
    best: Array,
) -> int:
    """Fill best (3,) with the plane of `level_plane`; gives how many points are on it."""
    margins = np.empty(len(rays))
    for n in range(len(rays)):
        z = 1.0 / rays[n, 2]
        margins[n] = margin_at(z, growth) / (z * z)
    most, plane = 0, np.empty(3)
    for k in range(len(draws)):
        if pick_near(rays, draws[k], plane) and -plane @ up > least_level * np.sqrt(plane @ plane):
            on = count_on(rays, margins, plane, most_below)
            if on > most:
                most = on
                best[:] = plane
    return most


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pick_near(rays: Array, draw: NDArray[np.int64], plane: Array) -> bool:
    """Fill plane (3,) with that through a point and two near it, of those drawn; false where it has none."""
    a = rays[draw[0]]
    others, count = np.empty((2, 3)), 0
    for n in range(1, len(draw)):
        b = rays[draw[n]]
        if count < 2 and abs(b[0] - a[0]) < ASIDE and abs(b[1] - a[1]) < ABOVE:
            others[count] = b - a
            count += 1
    area = others[0, 0] * others[1, 1] - others[0, 1] * others[1, 0]
    if count < 2 or area == 0.0:
        return False
    plane[0] = (others[0, 2] * others[1, 1] - others[1, 2] * others[0, 1]) / area
    plane[1] = (others[0, 0] * others[1, 2] - others[1, 0] * others[0, 2]) / area
    plane[2] = a[2] - plane[0] * a[0] - plane[1] * a[1]
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def count_on(rays: Array, margins: Array, plane: Array, most_below: float) -> int:
    """How many points are on a plane; 0 where more than so many are below it."""
    on = below = 0
    for n in range(len(rays)):
        off = rays[n, 2] - plane[0] * rays[n, 0] - plane[1] * rays[n, 1] - plane[2]
        if abs(off) < TIGHT * margins[n]:
            on += 1
        elif off < -2.0 * margins[n]:
            below += 1
            if below > most_below:
                return 0
    return on
