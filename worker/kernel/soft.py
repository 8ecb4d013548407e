"""Soft correspondences: under heavy noise an observed point may come from any visible sample around it.

The closest model point is not where a noisy point comes from: it lies the nearer, the more choice there is,
so limbs are drawn into what lies beside them. Here a pixel's measurement is what the camera does: it looks
somewhere near its own ray and errs along it. With samples x_k of the visible surface, p_i is distributed as

    p(p_i) = sum_k a_k / (2 pi s^2) exp(-1/2 (|across(p_i - x_k)|^2 / s^2 + along(p_i - x_k)^2 / t^2)) + e

with s and t the standard deviations across and along the ray, a_k the area that a sample stands for, and e
what is left for points of nothing. The gradient of log p sums the sample's pulls, each with its share
g_ik = p_k(p_i) / p(p_i), so its mean vanishes at the true pose. The information of the points is the sum of
the squares of their gradients (Fisher's scoring; Berndt, Hall, Hall & Hausman 1974), which leads down much
faster than the shares alone (EM) would. All is in units of s^2, as the hard correspondences are.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from common.kinematics import apply_step
from worker.kernel.evidence import Evidence, Rules
from worker.kernel.gauss_newton import (
    LIMIT_SHARE,
    Equations,
    clamp,
    draw_into_limits,
    hold_at_limits,
    solve_along_chains,
)
from worker.kernel.observation import BLOCK
from worker.kernel.samples import Grid
from worker.kernel.surface import Skeleton
from worker.kernel.visibility import PIXEL

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Indices = NDArray[np.int64]

REACH = 2.5  # standard deviations across, within which samples are sought
FARTHEST = 3  # pixels that this is at the most; samples are as far apart as it takes
SIDE = 2 * FARTHEST + 1
OUTLIER = 1e-3  # e, where a point amid a surface, exactly on it, has 1
LEAST = 1e-3  # share that counts
CAUTION = 0.02  # share of the information that there would be, were it known which sample each point is of
FREEDOM = 0.2  # radians and metres that a step is expected to be
LONGEST = 0.35  # radians and metres of a step
LANEWISE = {"reassoc", "contract", "nsz"}  # the compiler may sum up lane by lane


class Beams(NamedTuple):
    """Observed points of a block as the camera measured them."""

    right: Array  # (BLOCK,) of the ray, for each metre of depth
    down: Array
    depth: Points  # metres
    pixel: Points  # between samples, standard deviations
    column: Indices  # of the first sample around the point
    row: Indices
    place: NDArray[np.uint32]  # of that sample, among all


class Soft(NamedTuple):
    """Room for the samples of a block of points, and for one point's pull on each link."""

    beams: Beams
    across: Points  # (2, SIDE, BLOCK) parts of the density by column and row
    shares: Points  # (SIDE ** 2, BLOCK) the density by sample, row by row
    totals: Points  # (BLOCK,) its sum
    pulls: Array  # (L, 10) on a link: force and torque about the camera; where, times how much, and how much
    links: Indices  # (L,) that the point pulls at
    pulled: NDArray[np.bool_]  # (L,)
    complete: Array  # (D,) information, were all samples known
    score: Array  # (D,)


def lay_out_soft(dofs: int, links: int) -> Soft:
    """Room for a body of so many degrees of freedom and links."""
    return Soft(
        Beams(
            np.empty(BLOCK),
            np.empty(BLOCK),
            np.empty(BLOCK, dtype=np.float32),
            np.empty(BLOCK, dtype=np.float32),
            np.empty(BLOCK, dtype=np.int64),
            np.empty(BLOCK, dtype=np.int64),
            np.empty(BLOCK, dtype=np.uint32),
        ),
        np.empty((2, SIDE, BLOCK), dtype=np.float32),
        np.empty((SIDE * SIDE, BLOCK), dtype=np.float32),
        np.empty(BLOCK, dtype=np.float32),
        np.empty((links, 10)),
        np.empty(links, dtype=np.int64),
        np.zeros(links, dtype=np.bool_),
        np.empty(dofs),
        np.empty(dofs),
    )


@numba.njit(cache=True, nogil=True)
def sample_distance(rules: Rules) -> float:
    """Metres between samples."""
    return max(PIXEL, REACH * rules.noise_lateral / FARTHEST)


@numba.njit(cache=True, nogil=True)
def sample_reach(rules: Rules) -> int:
    """Pixels around a point within which its samples are sought."""
    return min(FARTHEST, int(REACH * rules.noise_lateral / sample_distance(rules) + 0.5))


@numba.njit(cache=True, nogil=True)
def step_softly(
    pose: Array, grid: Grid, skeleton: Skeleton, evidence: Evidence, rules: Rules, room: Soft, sums: Equations
) -> None:
    """Move pose (D,) in place by a step of scoring. sums.w and .q are the axes of motion in the pose."""
    gram, gradient = sums.gram, sums.gradient
    gather_scores(grid, skeleton, evidence, rules, room, sums)
    for j in range(len(pose)):
        gram[j, j] += CAUTION * room.complete[j] + (rules.noise_lateral / FREEDOM) ** 2
    if rules.keep_limits:
        draw_into_limits(skeleton, pose, LIMIT_SHARE * evidence.count, gram, gradient)
        hold_at_limits(skeleton, pose, gram, gradient)
    step = sums.step
    step[:] = -gradient
    solve_along_chains(skeleton.parents, gram, step)
    step *= min(1.0, LONGEST / max(np.max(np.abs(step)), 1e-9))
    apply_step(skeleton.axes, skeleton.balls, step, pose)
    if rules.keep_limits:
        clamp(skeleton, pose)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gather_scores(
    grid: Grid, skeleton: Skeleton, evidence: Evidence, rules: Rules, room: Soft, sums: Equations
) -> None:
    """Fill sums.gram with the points' information, .gradient with what leads up, and room.complete."""
    sums.gram[:] = 0.0
    sums.gradient[:] = 0.0
    room.complete[:] = 0.0
    reach = sample_reach(rules)
    stretch_squared, scale = rules.stretch * rules.stretch, 1.0 / rules.noise_lateral**2
    for first in range(0, evidence.count, BLOCK):
        share_out(first, grid, evidence, rules, reach, room)
        for i in range(min(BLOCK, evidence.count - first)):
            if room.totals[i] > 0.0:
                for n in range(pull_links(i, grid, skeleton, stretch_squared, reach, room)):
                    add_score(room.links[n], skeleton, stretch_squared, scale, room, sums)


@numba.njit(cache=True, nogil=True)
def share_out(first: int, grid: Grid, evidence: Evidence, rules: Rules, reach: int, room: Soft) -> None:
    """Fill room.beams, .shares and .totals for the block of points from the first on.

    Points that lie beside the grid have a density of nothing.
    """
    aim(evidence.points, first, rules.stretch, rules.noise_lateral, reach, grid, room.beams, room.across)
    for axis in range(2):
        spread(axis, 2 * reach + 1, room.beams.pixel, room.across)
    sharp = np.float32(-0.5 / rules.noise_depth**2)
    gather(grid.depth.ravel(), grid.depth.shape[1], 2 * reach + 1, room.beams.place, room.shares)
    weigh(2 * reach + 1, sharp, room.beams.depth, room.across, room.shares, room.totals)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def aim(
    points: Points,
    first: int,
    stretch: float,
    noise: float,
    reach: int,
    grid: Grid,
    beams: Beams,
    across: Points,
) -> None:
    """Fill beams, and across[:, 0] with how many samples the first one lies beyond the point's ray."""
    depth, width, height = grid.depth, grid.depth.shape[1] - 2 * reach, grid.depth.shape[0] - 2 * reach
    focal, left, top = grid.focal, grid.left, grid.top
    right, down, depths, pixel, columns, rows, place = beams
    for i in range(BLOCK):
        z = points[2, first + i] / stretch
        right[i], down[i], depths[i] = points[0, first + i] / z, points[1, first + i] / z, z
        u, v = focal * right[i] - left, focal * down[i] - top
        column, row = int(np.floor(u + 0.5)) - reach, int(np.floor(v + 0.5)) - reach
        inside = 0 <= row < height and 0 <= column < width
        row, column = (row, column) if inside else (0, 0)
        middle = depth[row + reach, column + reach]
        pixel[i] = (middle if middle < np.inf else depths[i]) / focal / noise if inside else 0.0
        columns[i], rows[i], place[i] = column, row, row * depth.shape[1] + column
        across[0, 0, i], across[1, 0, i] = (column - u, row - v) if inside else (0.0, 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=LANEWISE)
def spread(axis: int, side: int, pixel: Points, across: Points) -> None:
    """Turn across[axis, 0] into across[axis, :side], a Gaussian's mass by pixel for each point."""
    for k in range(side - 1, -1, -1):
        for i in range(BLOCK):
            x = (across[axis, 0, i] + np.float32(k)) * pixel[i]
            across[axis, k, i] = np.float32(0.3989422804) * pixel[i] * decay(np.float32(-0.5) * x * x)


@numba.njit(cache=True, nogil=True)
def gather(samples: Points, width: int, side: int, place: NDArray[np.uint32], shares: Points) -> None:
    """Fill shares (side ** 2, BLOCK) with the depths of the samples from each place on, row by row."""
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                shares[r * side + c, i] = samples[place[i] + np.uint32(r * width + c)]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=LANEWISE)
def weigh(
    side: int, sharp: np.float32, depth: Points, across: Points, shares: Points, totals: Points
) -> None:
    """Turn shares from samples' depths into their parts of the points' density; totals takes the sum."""
    totals[:] = 0.0
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                away = depth[i] - shares[r * side + c, i]
                share = across[0, c, i] * across[1, r, i] * decay(sharp * away * away)
                shares[r * side + c, i] = share
                totals[i] += share


@numba.njit(cache=True, nogil=True, inline="always")
def decay(x: np.float32) -> np.float32:
    """exp(x) of x <= 0 to 1e-4 of itself, 0 below -16, without a branch: Taylor's series of x / 64."""
    y = max(x, np.float32(-16.0)) * np.float32(1.0 / 64.0)
    e = np.float32(1.0 / 120.0) * y + np.float32(1.0 / 24.0)
    e = e * y + np.float32(1.0 / 6.0)
    e = e * y + np.float32(0.5)
    e = e * y + np.float32(1.0)
    e = e * y + np.float32(1.0)
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e if x > np.float32(-16.0) else np.float32(0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pull_links(i: int, grid: Grid, skeleton: Skeleton, stretch_squared: float, reach: int, room: Soft) -> int:
    """Fill room.pulls with point i's pull on links that can move, listed in room.links; gives how many."""
    pulls, shares, depth, beams = room.pulls, room.shares, grid.depth, room.beams
    right, down, here = beams.right[i], beams.down[i], beams.depth[i]
    side, count = 2 * reach + 1, 0
    total = np.float64(room.totals[i]) + OUTLIER
    nearer, least = 1.0 / grid.focal, LEAST * total
    for r in range(side):
        for c in range(side):
            if shares[r * side + c, i] < least:
                continue
            row, column = beams.row[i] + r, beams.column[i] + c
            s = grid.links[row, column]
            if skeleton.link_dofs[s] < 0:
                continue
            if not room.pulled[s]:
                room.pulled[s] = True
                room.links[count] = s
                pulls[s] = 0.0
                count += 1
            share, z = shares[r * side + c, i] / total, np.float64(depth[row, column])
            x, y = (column + grid.left) * z * nearer, (row + grid.top) * z * nearer
            fx, fy = share * (right * z - x), share * (down * z - y)
            fz = share * stretch_squared * (here - z)
            pull = pulls[s]
            pull[0] += fx
            pull[1] += fy
            pull[2] += fz
            pull[3] += y * fz - z * fy
            pull[4] += z * fx - x * fz
            pull[5] += x * fy - y * fx
            pull[6] += share * x
            pull[7] += share * y
            pull[8] += share * z
            pull[9] += share
    for k in range(count):
        room.pulled[room.links[k]] = False
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_score(
    link: int, skeleton: Skeleton, stretch_squared: float, scale: float, room: Soft, sums: Equations
) -> None:
    """Add a point's gradient by the degrees of freedom that move a link, and its square times `scale`.

    room.complete grows by what the point would tell, were it certain from which sample it comes.
    """
    w, q, pull, score = sums.w, sums.q, room.pulls[link], room.score
    mass = pull[9]
    x, y, z = pull[6] / mass, pull[7] / mass, pull[8] / mass
    tx, ty, tz = (
        pull[3] - y * pull[2] + z * pull[1],
        pull[4] - z * pull[0] + x * pull[2],
        pull[5] - x * pull[1] + y * pull[0],
    )
    last = skeleton.link_dofs[link]
    j = last
    while j >= 0:
        dx, dy, dz = w[j, 0], w[j, 1], w[j, 2]
        score[j] = 0.0
        if skeleton.kinds[j] != 0:
            score[j] = dx * tx + dy * ty + dz * tz
            ax, ay, az = x - q[j, 0], y - q[j, 1], z - q[j, 2]
            dx, dy, dz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
        score[j] += dx * pull[0] + dy * pull[1] + dz * pull[2]
        room.complete[j] += mass * (dx * dx + dy * dy + stretch_squared * dz * dz)
        sums.gradient[j] -= score[j]
        k = last
        while k >= j:
            sums.gram[k, j] += scale * score[k] * score[j]
            k = skeleton.parents[k]
        j = skeleton.parents[j]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mean_log_density(grid: Grid, evidence: Evidence, rules: Rules, room: Soft) -> float:
    """Mean log p of the observed points."""
    total, reach = 0.0, sample_reach(rules)
    for first in range(0, evidence.count, BLOCK):
        share_out(first, grid, evidence, rules, reach, room)
        for i in range(min(BLOCK, evidence.count - first)):
            total += np.log(np.float64(room.totals[i]) + OUTLIER)
    return total / evidence.count
