"""A step of Fisher scoring: uphill on the log density of soft correspondences.

The gradient of log p sums the residuals of a point from its samples by their responsibilities, and its mean
vanishes at the true pose. The information of the points is the sum of the outer products of their gradients
(scoring; Berndt, Hall, Hall & Hausman 1974), which leads up much faster than the responsibilities alone (EM)
would.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import forward_kinematics, motion_axes
from common.kinematics.limits import clamp_to_limits
from common.kinematics.manifold import apply_step
from worker.kernel.observation import BLOCK
from worker.kernel.packing import KernelParameters, PackedObservation
from worker.kernel.soft.responsibilities import (
    OUTLIER_DENSITY,
    SoftBuffers,
    compute_responsibilities,
    sample_distance,
    sample_radius,
)
from worker.kernel.soft.samples import SampleGrid, sample
from worker.kernel.solver.gauss_newton import solve_ltl
from worker.kernel.solver.normal_equations import NormalEquations
from worker.kernel.solver.priors import LIMIT_SHARE, add_limit_prior, hold_active_limits
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.visibility import pose_surface
from worker.kernel.workspace import Workspace

Array = NDArray[np.float64]

LEAST_RESPONSIBILITY = 3e-5  # what is below it is left out
EXPECTED_STEP = 0.2  # radians and metres, a step's expected size
LARGEST_STEP = 0.35  # radians and metres, a step's largest size


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
    grid = sample(view, surface, sample_distance(parameters), workspace.samples)
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
