"""Keypoints: points of the body that a network has seen in a camera's colour image.

The cost is half the sum of rho(r_k), with r_k the distance in the image, in standard deviations of the
keypoint, and rho a robust kernel: left and right may be swapped, or a keypoint may be another person's. A
keypoint whose point on the body is behind the camera counts as infinitely far.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.common.refinement import KEYPOINT_OUTLIER
from gepf.worker.kernel.shape import fill_drifts, place_fields
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.visibility import NEAREST_M
from gepf.worker.kernel.workspace import CameraView

PER_OUTLIER_SQUARED = KEYPOINT_OUTLIER**-2


@numba.njit(cache=True, nogil=True)
def cost(view: CameraView) -> float:
    """Cost of the keypoints of a camera."""
    keypoints, seen, total = view.problem.keypoints, view.observed.keypoints, 0.0
    if view.weights.keypoints == 0.0 or len(seen) == 0 or len(keypoints.links) == 0:
        return 0.0
    forces, place = np.empty((2, 3)), np.empty(3)
    for k in range(len(keypoints.links)):
        right, down, z = residual_of(k, view, forces, place)
        if z > NEAREST_M:
            total += robust_cost(seen[k, 2] * (right * right + down * down), PER_OUTLIER_SQUARED)
        elif seen[k, 2] > 0.0:
            total += KEYPOINT_OUTLIER**2
    return 0.5 * view.weights.keypoints * total


@numba.njit(cache=True, nogil=True)
def linearise(view: CameraView) -> None:
    """Add to the link of each keypoint the wrenches of its two residuals, and the products of their rows."""
    keypoints, seen, skeleton = view.problem.keypoints, view.observed.keypoints, view.problem.skeleton
    if view.weights.keypoints == 0.0 or len(seen) == 0 or len(keypoints.links) == 0:
        return
    workspace, equations = view.workspace, view.workspace.equations
    drifts, fields, links = equations.drifts, equations.fields, equations.links
    fill_drifts(skeleton.kinds, skeleton.parents, skeleton.shape_points, workspace.of_rig, drifts)
    forces, place, row = np.empty((2, 3)), np.empty(3), np.empty(links.shape[1])
    for k in range(len(keypoints.links)):
        link = keypoints.links[k]
        j = skeleton.link_dofs[link]
        right, down, z = residual_of(k, view, forces, place)
        if seen[k, 2] == 0.0 or z <= NEAREST_M or j < 0:
            continue
        squared = seen[k, 2] * (right * right + down * down)
        pull = view.weights.keypoints * seen[k, 2] * robust_weight(squared, PER_OUTLIER_SQUARED)
        place_fields(workspace.of_rig[j], skeleton.shape_fields[link], drifts[j], fields)
        x, y, z = keypoints.points[k, 0], keypoints.points[k, 1], keypoints.points[k, 2]
        for a in range(2):
            force = forces[a]
            for b in range(3):
                c, d = (b + 1) % 3, (b + 2) % 3
                row[b] = place[c] * force[d] - place[d] * force[c]
                row[3 + b] = force[b]
            for s in range(len(fields)):
                row[6 + s] = 0.0
                for b in range(3):
                    f = fields[s, b]
                    row[6 + s] += force[b] * (f[0] * x + f[1] * y + f[2] * z + f[3])
            off = right if a == 0 else down
            for b in range(len(row)):
                links[link, b, -1] += pull * off * row[b]
                for c in range(len(row)):
                    links[link, b, c] += pull * row[b] * row[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def residual_of(k: int, view: CameraView, forces: Array, place: Array) -> tuple[float, float, float]:
    """Offset of keypoint k of the body, to the right and down from where it was seen (pixels), and its depth.

    Fills place (3,) of the keypoint, and forces (2, 3) with the derivatives of both residuals with respect
    to it, all in the rig's frame at the time of the frame. The camera's own time may differ, as for points.
    """
    skeleton, workspace, lens = view.problem.skeleton, view.workspace, view.observed.lens
    point, link = view.problem.keypoints.points[k], view.problem.keypoints.links[k]
    shaped, of_rig = workspace.of_links[link], workspace.of_rig[skeleton.link_dofs[link]]
    at_rest, x = np.empty(3), np.empty(3)
    for a in range(3):
        place[a] = shaped[a, 0] * point[0] + shaped[a, 1] * point[1] + shaped[a, 2] * point[2] + shaped[a, 3]
    for a in range(3):
        at_rest[a] = 0.0
        for b in range(3):
            at_rest[a] += of_rig[b, a] * (place[b] - of_rig[b, 3])
    t, turn = workspace.transforms[skeleton.link_dofs[link]], workspace.T_camera_rig
    for a in range(3):
        x[a] = t[a, 0] * at_rest[0] + t[a, 1] * at_rest[1] + t[a, 2] * at_rest[2] + t[a, 3]
    per_z = 1.0 / x[2]
    right = lens[2] + lens[0] * x[0] * per_z - view.observed.keypoints[k, 0]
    down = lens[3] + lens[1] * x[1] * per_z - view.observed.keypoints[k, 1]
    for b in range(3):
        forces[0, b] = lens[0] * per_z * (turn[0, b] - x[0] * per_z * turn[2, b])
        forces[1, b] = lens[1] * per_z * (turn[1, b] - x[1] * per_z * turn[2, b])
    return right, down, x[2]
