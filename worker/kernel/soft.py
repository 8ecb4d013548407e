"""Soft correspondences: under heavy noise an observed point may come from any visible sample around it.

The closest model point is not where a noisy point comes from: it lies the nearer, the more choice there is,
so limbs are drawn into what lies beside them. Here a pixel's measurement is what the camera does: it looks
somewhere near its own ray and errs along it. With samples x_k of the visible surface, p_i is distributed as

    p(p_i) = sum_k a_k / (2 pi s^2) exp(-1/2 (|across(p_i - x_k)|^2 / s^2 + along(p_i - x_k)^2 / t^2)) + e

with s and t the standard deviations across and along the ray, across(p_i - x_k) what the ray passes the
sample by at the sample's depth, a_k the area of a sample, which stands for the same solid angle at any
depth, and e what is left for outliers. A sample's responsibility for the point is g_ik = p_k(p_i) / p(p_i).
All is in units of s^2, as the hard correspondences are.

A step of Fisher scoring leads uphill: the gradient of log p sums the residuals of a point from its samples by
their responsibilities, and its mean vanishes at the true pose. The information of the points is the sum of
the outer products of their gradients (Berndt, Hall, Hall & Hausman 1974), which leads up much faster than the
responsibilities alone (EM) would.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import forward_kinematics, motion_axes
from common.kinematics.manifold import apply_step, clamp_to_limits
from worker.kernel.gauss_newton import solve_ltl
from worker.kernel.neighbourhoods import BLOCK
from worker.kernel.observation import PackedObservation
from worker.kernel.parameters import KernelParameters
from worker.kernel.priors import LIMIT_SHARE, add_limit_prior, hold_active_limits
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.visibility import NEAR, PIXEL, faces_camera, pose_surface, project_vertices
from worker.kernel.workspace import (
    LARGEST_RADIUS,
    LARGEST_SIDE,
    NormalEquations,
    Rays,
    SoftBuffers,
    VisibilityBuffers,
    Workspace,
)

Array = NDArray[np.float64]


MARGIN = 12  # pixels around the model in which nothing is


Points = NDArray[np.float32]
Indices = NDArray[np.int64]

SEARCH_DEVIATIONS = 2.5  # standard deviations across, within which samples are sought
OUTLIER_DENSITY = 1e-3  # e, where a point amid a surface, exactly on it, has 1
FAR = np.float32(1e4)  # metres: farther than any sample
VECTORISED = {"reassoc", "contract", "nsz"}  # the compiler may sum up lane by lane
LEAST_RESPONSIBILITY = 3e-5  # what is below it is left out
EXPECTED_STEP = 0.2  # radians and metres, a step's expected size
LARGEST_STEP = 0.35  # radians and metres, a step's largest size


class SampleGrid(NamedTuple):
    """Samples of one pose: that of row r and column c lies on the ray through (c + left, r + top, focal)."""

    depth: NDArray[np.float32]  # (H, W) metres, infinite where the model is not seen
    links: NDArray[np.int32]  # (H, W)
    left: int
    top: int
    focal: float  # pixels


@numba.njit(cache=True, nogil=True)
def sample(view: VisibilityBuffers, surface: Surface, pixel: float, buffers: SoftBuffers) -> SampleGrid:
    """Samples of the surface as view.posed has it, every `pixel` metres at the body's mean distance."""
    posed, image, triangles = view.posed, view.image, surface.triangles
    shrink = PIXEL / pixel
    left, top, right, bottom = project_vertices(posed, image)
    image *= shrink
    left, top = int(np.floor(left * shrink)) - MARGIN, int(np.floor(top * shrink)) - MARGIN
    right, bottom = int(np.ceil(right * shrink)) + MARGIN, int(np.ceil(bottom * shrink)) + MARGIN
    width = max(2 * MARGIN, min(LARGEST_SIDE, right - left + 1))  # of what lies too far off edges overflow
    height = max(2 * MARGIN, min(LARGEST_SIDE, bottom - top + 1))
    grid = SampleGrid(
        buffers.depth[: height * width].reshape(height, width),
        buffers.sampled_links[: height * width].reshape(height, width),
        left,
        top,
        float(np.mean(posed[:, 2])) / pixel,
    )
    grid.depth[:] = np.inf
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if faces_camera(image, a, b, c) and min(posed[a, 2], posed[b, 2], posed[c, 2]) > NEAR:
            sample_triangle(image, posed, a, b, c, surface.skin_links[a, 0], grid)
    grid.depth[:MARGIN] = grid.depth[height - MARGIN :] = np.inf
    grid.depth[:, :MARGIN] = grid.depth[:, width - MARGIN :] = np.inf
    return grid


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sample_triangle(image: Array, posed: Array, a: int, b: int, c: int, link: int, grid: SampleGrid) -> None:
    """Put the triangle into the grid wherever it covers a pixel's centre and nothing is nearer."""
    ax, ay = image[a, 0] - grid.left, image[a, 1] - grid.top
    bx, by = image[b, 0] - grid.left - ax, image[b, 1] - grid.top - ay  # from a
    cx, cy = image[c, 0] - grid.left - ax, image[c, 1] - grid.top - ay
    depth, links = grid.depth, grid.links
    first_column = max(0, int(np.ceil(ax + min(0.0, bx, cx))))
    last_column = min(depth.shape[1] - 1, int(np.floor(ax + max(0.0, bx, cx))))
    first_row = max(0, int(np.ceil(ay + min(0.0, by, cy))))
    last_row = min(depth.shape[0] - 1, int(np.floor(ay + max(0.0, by, cy))))
    if first_column > last_column or first_row > last_row:
        return
    scale = 1.0 / (bx * cy - by * cx)
    z, zb, zc = posed[a, 2], posed[b, 2] - posed[a, 2], posed[c, 2] - posed[a, 2]
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            x, y = column - ax, row - ay
            wb, wc = (x * cy - y * cx) * scale, (bx * y - by * x) * scale
            here = np.float32(z + wb * zb + wc * zc)
            if wb >= -1e-9 and wc >= -1e-9 and wb + wc <= 1.0 + 1e-9 and here < depth[row, column]:
                depth[row, column] = here
                links[row, column] = link


@numba.njit(cache=True, nogil=True)
def sample_distance(parameters: KernelParameters) -> float:
    """Metres between samples."""
    return max(PIXEL, SEARCH_DEVIATIONS * parameters.noise_lateral / LARGEST_RADIUS)


@numba.njit(cache=True, nogil=True)
def sample_radius(parameters: KernelParameters) -> int:
    """Pixels around a point within which its samples are sought."""
    return min(
        LARGEST_RADIUS, int(SEARCH_DEVIATIONS * parameters.noise_lateral / sample_distance(parameters) + 0.5)
    )


@numba.njit(cache=True, nogil=True)
def compute_responsibilities(
    first: int,
    grid: SampleGrid,
    observed: PackedObservation,
    parameters: KernelParameters,
    radius: int,
    buffers: SoftBuffers,
) -> None:
    """Fill buffers.rays, .densities and .totals for the block of points from the first on.

    The responsibility g_ik is densities / (totals + OUTLIER_DENSITY). Points beside the grid have density 0.
    """
    ray_residuals(observed.points, first, parameters.stretch, radius, grid, buffers.rays, buffers.across)
    for axis in range(2):
        square_residuals(axis, 2 * radius + 1, buffers.across)
    gather_depths(
        grid.depth.ravel(), grid.depth.shape[1], 2 * radius + 1, buffers.rays.place, buffers.densities
    )
    sample_densities(
        2 * radius + 1,
        np.float32(1.0 / (grid.focal * parameters.noise_lateral) ** 2),
        np.float32(-0.5 / parameters.noise_depth**2),
        buffers.rays.depth,
        buffers.across,
        buffers.densities,
        buffers.totals,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def ray_residuals(
    points: Points, first: int, stretch: float, radius: int, grid: SampleGrid, rays: Rays, across: Points
) -> None:
    """Fill rays, and across[:, 0] with each ray's residual from the first sample around it, in samples.

    What is beside the grid is held against its corner, where there are none.
    """
    depth, width, height = grid.depth, grid.depth.shape[1] - 2 * radius, grid.depth.shape[0] - 2 * radius
    focal, left, top = grid.focal, grid.left, grid.top
    right, down, depths, columns, rows, place = rays
    for i in range(BLOCK):
        z = points[2, first + i] / stretch
        right[i], down[i], depths[i] = points[0, first + i] / z, points[1, first + i] / z, z
        u, v = focal * right[i] - left, focal * down[i] - top
        column, row = int(np.floor(u + 0.5)) - radius, int(np.floor(v + 0.5)) - radius
        inside = 0 <= row < height and 0 <= column < width
        row, column = (row, column) if inside else (0, 0)
        columns[i], rows[i], place[i] = column, row, row * depth.shape[1] + column
        across[0, 0, i], across[1, 0, i] = (column - u, row - v) if inside else (0.0, 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=VECTORISED)
def square_residuals(axis: int, side: int, across: Points) -> None:
    """Turn across[axis, 0] into across[axis, :side]: squared residuals from each sample on."""
    for k in range(side - 1, -1, -1):
        for i in range(BLOCK):
            x = across[axis, 0, i] + np.float32(k)
            across[axis, k, i] = x * x


@numba.njit(cache=True, nogil=True)
def gather_depths(
    samples: Points, width: int, side: int, place: NDArray[np.uint32], densities: Points
) -> None:
    """Fill densities (side ** 2, BLOCK) with the depths of the samples from each place on, row by row.

    No sample is one that is far.
    """
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                densities[r * side + c, i] = min(samples[place[i] + np.uint32(r * width + c)], FAR)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=VECTORISED)
def sample_densities(
    side: int,
    areas: np.float32,
    exponent: np.float32,
    depth: Points,
    across: Points,
    densities: Points,
    totals: Points,
) -> None:
    """Turn densities from samples' depths into p_k(p_i); totals takes the sums over k.

    `areas` is a sample's area (in units of s^2) for a squared metre of depth.
    """
    totals[:] = 0.0
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                z = densities[r * side + c, i]
                away, area = depth[i] - z, areas * z * z if z < FAR else np.float32(0.0)
                squares = across[0, c, i] + across[1, r, i]
                passing = decay(exponent * away * away - np.float32(0.5) * area * squares)
                density = np.float32(0.15915494309) * area * passing
                densities[r * side + c, i] = density
                totals[i] += density


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


@numba.njit(cache=True, nogil=True)
def fisher_scoring_step(
    pose: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Move pose (D,) in place by one step."""
    equations = workspace.equations
    fill_soft_equations(pose, skeleton, surface, observed, parameters, workspace)
    equations.information[:] = equations.gram
    for j in range(len(pose)):
        equations.gram[j, j] += (parameters.noise_lateral / EXPECTED_STEP) ** 2
    hold_active_limits(skeleton, pose, equations.gram, equations.gradient)
    step = equations.step
    step[:] = -equations.gradient
    solve_ltl(skeleton.parents, equations.gram, step)
    step *= min(1.0, LARGEST_STEP / max(np.max(np.abs(step)), 1e-9))
    apply_step(skeleton.axes, skeleton.balls, step, pose)
    clamp_to_limits(skeleton.single, skeleton.limits, pose)


@numba.njit(cache=True, nogil=True)
def fill_soft_equations(
    pose: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Fill workspace.equations: information, and minus the slope of the log posterior, in units of s^2.

    Of as many points as there are, with the samples that are seen at pose (D,).
    """
    view, equations, transforms = workspace.visibility, workspace.equations, workspace.transforms
    forward_kinematics(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, transforms)
    pose_surface(surface, transforms, skeleton.link_dofs, view.posed)
    motion_axes(
        skeleton.parents,
        skeleton.axes,
        skeleton.points,
        skeleton.balls,
        transforms,
        equations.w,
        equations.q,
    )
    grid = sample(view, surface, sample_distance(parameters), workspace.soft)
    accumulate_scores(grid, skeleton, observed, parameters, workspace.soft, equations)
    add_limit_prior(skeleton, pose, LIMIT_SHARE * observed.count, equations.gram, equations.gradient)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def accumulate_scores(
    grid: SampleGrid,
    skeleton: Skeleton,
    observed: PackedObservation,
    parameters: KernelParameters,
    buffers: SoftBuffers,
    equations: NormalEquations,
) -> None:
    """Fill equations.gram with the points' information, .gradient with minus their score.

    equations.w and .q hold the axes of motion in the grid's pose.
    """
    equations.gram[:] = 0.0
    equations.gradient[:] = 0.0
    radius = sample_radius(parameters)
    stretch_squared, scale = parameters.stretch * parameters.stretch, 1.0 / parameters.noise_lateral**2
    for first in range(0, observed.count, BLOCK):
        compute_responsibilities(first, grid, observed, parameters, radius, buffers)
        for i in range(min(BLOCK, observed.count - first)):
            if buffers.totals[i] > 0.0:
                for n in range(
                    accumulate_wrenches(i, grid, skeleton, stretch_squared, scale, radius, buffers)
                ):
                    add_score(buffers.links[n], skeleton, scale, buffers, equations)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def accumulate_wrenches(
    i: int,
    grid: SampleGrid,
    skeleton: Skeleton,
    stretch_squared: float,
    scale: float,
    radius: int,
    buffers: SoftBuffers,
) -> int:
    """Fill buffers.wrenches with point i's wrench on each link that can move; returns how many links.

    Farther away a sample's density over the rays is narrower and higher, which draws it there as much as
    chance residuals across draw it near. `scale` is 1 / s^2.

    The links are listed in buffers.links.
    """
    wrenches, densities, depth, rays = buffers.wrenches, buffers.densities, grid.depth, buffers.rays
    right, down, here = rays.right[i], rays.down[i], rays.depth[i]
    side, count = 2 * radius + 1, 0
    total = np.float64(buffers.totals[i]) + OUTLIER_DENSITY
    nearer, least = 1.0 / grid.focal, LEAST_RESPONSIBILITY * total
    for r in range(side):
        for c in range(side):
            if not densities[r * side + c, i] >= least:  # or it is no number
                continue
            row, column = rays.row[i] + r, rays.column[i] + c
            s = grid.links[row, column]
            if skeleton.link_dofs[s] < 0:
                continue
            if not buffers.touched[s]:
                buffers.touched[s] = True
                buffers.links[count] = s
                wrenches[s] = 0.0
                count += 1
            responsibility, z = densities[r * side + c, i] / total, np.float64(depth[row, column])
            x, y = (column + grid.left) * z * nearer, (row + grid.top) * z * nearer
            fx, fy = responsibility * (right * z - x), responsibility * (down * z - y)
            fz = responsibility * (stretch_squared * (here - z) + 2.0 / (scale * z)) - right * fx - down * fy
            wrench = wrenches[s]
            wrench[0] += fx
            wrench[1] += fy
            wrench[2] += fz
            wrench[3] += y * fz - z * fy
            wrench[4] += z * fx - x * fz
            wrench[5] += x * fy - y * fx
    for k in range(count):
        buffers.touched[buffers.links[k]] = False
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_score(
    link: int, skeleton: Skeleton, scale: float, buffers: SoftBuffers, equations: NormalEquations
) -> None:
    """Add a point's gradient by the degrees of freedom that move a link, and its square times `scale`."""
    w, q, wrench, score = equations.w, equations.q, buffers.wrenches[link], buffers.score
    fx, fy, fz, tx, ty, tz = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    last = skeleton.link_dofs[link]
    j = last
    while j >= 0:
        dx, dy, dz, x, y, z = w[j, 0], w[j, 1], w[j, 2], q[j, 0], q[j, 1], q[j, 2]
        if skeleton.kinds[j] == 0:
            score[j] = dx * fx + dy * fy + dz * fz
        else:  # the torque about its axis
            ax, ay, az = tx - y * fz + z * fy, ty - z * fx + x * fz, tz - x * fy + y * fx
            score[j] = dx * ax + dy * ay + dz * az
        equations.gradient[j] -= score[j]
        k = last
        while k >= j:
            equations.gram[k, j] += scale * score[k] * score[j]
            k = skeleton.parents[k]
        j = skeleton.parents[j]
