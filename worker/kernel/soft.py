"""Soft correspondences: under heavy noise an observed point may come from any visible sample around it.

The closest model point is a biased estimate of the origin of a noisy point: more model points nearby mean a
shorter distance. So limbs are pulled towards the surface beside them. Here the measurement of a pixel is
modelled as noise across and along its ray. With samples x_k of the visible surface, p_i has the density

    p(p_i) = sum_k a_k / (2 pi s^2) exp(-1/2 (|across(p_i - x_k)|^2 / s^2 + along(p_i - x_k)^2 / t^2)) + e

Here s and t are the standard deviations across and along the ray, across(p_i - x_k) is the offset between ray
and sample at the sample's depth, a_k is the area of a sample, which covers the same solid angle at any depth,
and e is the density of outliers. The responsibility of a sample for a point is g_ik = p_k(p_i) / p(p_i). All
terms are in units of s^2, as for hard correspondences. Samples are pixels of the model's depth image.

A step of Fisher scoring increases the likelihood. The gradient of log p is the sum of a point's residuals
from its samples, weighted by their responsibilities; its mean is zero at the true pose. The information is
the sum of the outer products of the points' gradients (Berndt, Hall, Hall & Hausman 1974). This converges
much faster than EM.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.worker.kernel.gauss_newton import take_step
from gepf.worker.kernel.normal_equations import power, twists_of
from gepf.worker.kernel.observation import PackedObservation, view_of
from gepf.worker.kernel.parameters import KernelParameters
from gepf.worker.kernel.priors import add_prior
from gepf.worker.kernel.surface import Skeleton, Surface
from gepf.worker.kernel.visibility import PIXEL_M, DepthImage, draw, pose_body
from gepf.worker.kernel.workspace import Problem, Workspace, Workspaces, workspace_of

SEARCH_DEVIATIONS = 2.5  # radius of the search for samples, in standard deviations across
MOST_SAMPLES_ASIDE = 3  # of a point, in each direction; with more noise they are farther apart
OUTLIER_DENSITY = 1e-3  # e, relative to the density of a point exactly on a wide surface
LONGEST_STEP = 0.2  # radians and metres


@numba.njit(cache=True, nogil=True)
def fisher_scoring_step(pose: Array, problem: Problem, workspaces: Workspaces) -> None:
    """Move pose (D,) in place by one step. Damping is a prior on the step, as wide as the longest step."""
    skeleton, surface, views, parameters = problem
    equations = workspaces.shared.equations
    equations.gram[:], equations.gradient[:] = 0.0, 0.0
    for v in range(len(views.extents)):
        observed, workspace = view_of(views, v), workspace_of(workspaces, views, v)
        add_soft_equations(pose, skeleton, surface, observed, parameters, workspace)
    add_prior(skeleton, pose, parameters.rest_weight, views.total, equations.gram, equations.gradient)
    damping = (parameters.noise_lateral / LONGEST_STEP) ** 2
    take_step(skeleton, pose, damping, LONGEST_STEP, equations)


@numba.njit(cache=True, nogil=True)
def add_soft_equations(
    pose: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Add to workspace.equations: information, and minus the gradient of the log posterior, in units of s^2.

    Over all points observed by a camera, with the samples that are visible in pose (D,).
    """
    gram, gradient, wrenches = workspace.equations.gram, workspace.equations.gradient, workspace.wrenches
    score = np.empty(len(pose))
    pose_body(pose, skeleton, surface, workspace)
    twists = twists_of(skeleton, workspace.of_rig)
    turn_twists(workspace.T_camera_rig, twists)
    seen = draw(surface.triangles, True, workspace)
    scale = 1.0 / parameters.noise_lateral**2
    for i in range(observed.count):
        density = fill_wrenches(i, seen, surface, observed, parameters, wrenches)
        for link in range(len(wrenches)):
            if wrenches[link, 6] > 0.0:
                last = skeleton.link_dofs[link]
                wrenches[link] /= density
                j = last
                while j >= 0:
                    score[j] = power(twists[j], wrenches[link])
                    j = skeleton.parents[j]
                j = last
                while j >= 0:
                    gradient[j] -= score[j]
                    k = last
                    while k >= j:
                        gram[k, j] += scale * score[k] * score[j]
                        k = skeleton.parents[k]
                    j = skeleton.parents[j]


@numba.njit(cache=True, nogil=True)
def turn_twists(T_camera_rig: Array, twists: Array) -> None:
    """Convert twists (D, 6) about the rig's origin to twists about the camera, in place."""
    x, y, z = T_camera_rig[0, 3], T_camera_rig[1, 3], T_camera_rig[2, 3]
    for j in range(len(twists)):
        w = rotate(T_camera_rig, twists[j, 0], twists[j, 1], twists[j, 2])
        u = rotate(T_camera_rig, twists[j, 3], twists[j, 4], twists[j, 5])
        twists[j, 0], twists[j, 1], twists[j, 2] = w
        twists[j, 3] = u[0] + y * w[2] - z * w[1]
        twists[j, 4] = u[1] + z * w[0] - x * w[2]
        twists[j, 5] = u[2] + x * w[1] - y * w[0]


@numba.njit(cache=True, nogil=True)
def rotate(T: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector, rotated. numba's matrix product would need scipy, a quarter of a worker's disk space."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_wrenches(
    i: int,
    seen: DepthImage,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    wrenches: Array,
) -> float:
    """p(p_i); fills wrenches (L, 7) with the wrench of the point on each link, times p(p_i).

    A row is the torque about the camera, the force, and the sum of p_k(p_i). The density of a sample over the
    rays is narrower and higher the farther the sample is. The force that follows, away from the camera,
    balances the mean force of the residuals across the rays, towards the camera.
    """
    depth, focal, stretch = seen.depth, seen.focal, parameters.stretch
    per_focal, per_noise = 1.0 / focal, 1.0 / parameters.noise_depth
    seen_triangles, triangles, links = seen.triangles, surface.triangles, surface.skin_links
    height, width = depth.shape
    z_observed = observed.points[2, i] / stretch
    right, down = observed.points[0, i] / z_observed, observed.points[1, i] / z_observed
    left, top = seen.left, seen.top
    u, v = focal * right - left, focal * down - top
    aside, apart = sample_window(parameters.noise_lateral)
    scale, density = 1.0 / parameters.noise_lateral**2, OUTLIER_DENSITY
    wrenches[:] = 0.0
    if not (-aside <= u < width + aside and -aside <= v < height + aside):
        return density
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    for r in range(row - aside, row + aside + 1, apart):
        for c in range(column - aside, column + aside + 1, apart):
            if not (0 <= r < height and 0 <= c < width and depth[r, c] < np.inf):
                continue
            z = np.float64(depth[r, c])
            pixel = scale * (z * per_focal) ** 2
            across, along = pixel * ((c - u) ** 2 + (r - v) ** 2), (z_observed - z) * per_noise
            this = apart * apart * pixel / (2.0 * np.pi) * np.exp(-0.5 * (across + along * along))
            density += this
            x, y = (c + left) * z * per_focal, (r + top) * z * per_focal
            fx, fy = this * (right * z - x), this * (down * z - y)
            fz = this * (stretch * stretch * (z_observed - z) + 2.0 / (scale * z)) - right * fx - down * fy
            link = links[triangles[seen_triangles[r, c], 0], 0]
            wrenches[link, 0] += y * fz - z * fy
            wrenches[link, 1] += z * fx - x * fz
            wrenches[link, 2] += x * fy - y * fx
            wrenches[link, 3] += fx
            wrenches[link, 4] += fy
            wrenches[link, 5] += fz
            wrenches[link, 6] += this
    return density


@numba.njit(cache=True, nogil=True, inline="always")
def sample_window(noise_lateral: float) -> tuple[int, int]:
    """Half width in pixels of the window around a point in which its samples lie, and their spacing."""
    reach = SEARCH_DEVIATIONS * noise_lateral / PIXEL_M
    apart = 1 + int(reach / MOST_SAMPLES_ASIDE)
    return apart * int(reach / apart + 0.5), apart


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mean_log_density(
    surface: Surface, observed: PackedObservation, parameters: KernelParameters, workspace: Workspace
) -> float:
    """Mean log p(p_i) of the observed points, in the pose of the body in workspace."""
    seen, total = draw(surface.triangles, True, workspace), 0.0
    for i in range(observed.count):
        total += np.log(fill_wrenches(i, seen, surface, observed, parameters, workspace.wrenches))
    return total / observed.count
