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
from gepf.worker.kernel.observation import PackedObservation
from gepf.worker.kernel.parameters import KernelParameters
from gepf.worker.kernel.surface import Surface
from gepf.worker.kernel.visibility import PIXEL_M, DepthImage, draw
from gepf.worker.kernel.workspace import CameraView

SEARCH_DEVIATIONS = 2.5  # radius of the search for samples, in standard deviations across
MOST_SAMPLES_ASIDE = 3  # of a point, in each direction; with more noise they are farther apart
OUTLIER_DENSITY = 1e-3  # e, relative to the density of a point exactly on a wide surface


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Minus the log densities of the points of a camera, weighted."""
    surface, parameters, total = view.problem.surface, view.problem.parameters, 0.0
    if view.weights.soft == 0.0:
        return 0.0
    seen = draw(surface.triangles, True, view.workspace)
    for i in range(view.observed.count):
        wrenches = view.workspace.wrenches
        total -= np.log(fill_wrenches(i, seen, surface, view.observed, parameters, wrenches))
    return view.weights.soft * total


@numba.njit(cache=True, nogil=True)
def linearise(view: CameraView) -> None:
    """Add to each link the wrenches of all points, and the outer products of each with itself."""
    surface, parameters, workspace = view.problem.surface, view.problem.parameters, view.workspace
    weight, wrenches, per_variance = view.weights.soft, workspace.wrenches, 1.0 / parameters.noise_lateral**2
    if weight == 0.0:
        return
    links = np.zeros((len(wrenches), 6, 7))
    seen = draw(surface.triangles, True, workspace)
    for i in range(view.observed.count):
        density = fill_wrenches(i, seen, surface, view.observed, parameters, wrenches)
        for link in range(len(wrenches)):
            if wrenches[link, 6] > 0.0:
                score = wrenches[link, :6]
                score *= per_variance / density
                for a in range(6):
                    for b in range(6):
                        links[link, a, b] += weight * score[a] * score[b]
                    links[link, a, 6] -= weight * score[a]
    add_from_camera(workspace.T_camera_rig, links, workspace.equations.links)


@numba.njit(cache=True, nogil=True)
def add_from_camera(T_camera_rig: Array, links: Array, out: Array) -> None:
    """Add matrices and wrenches (L, 6, 7) about the camera to those about the rig's origin.

    A twist (w, v) in the rig is (R w, R v + t x R w) in the camera.
    """
    turn, t = T_camera_rig, T_camera_rig[:, 3]
    twist, half = np.zeros((6, 6)), np.empty((6, 7))
    for b in range(3):
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            twist[a, b] = twist[3 + a, 3 + b] = turn[a, b]
            twist[3 + a, b] = t[c] * turn[d, b] - t[d] * turn[c, b]
    for link in range(len(links)):
        for a in range(6):
            for b in range(7):
                half[a, b] = 0.0
                for c in range(6):
                    half[a, b] += twist[c, a] * links[link, c, b]
        for a in range(6):
            out[link, a, 6] += half[a, 6]
            for b in range(6):
                for c in range(6):
                    out[link, a, b] += half[a, c] * twist[c, b]


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
