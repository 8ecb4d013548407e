"""The surface around each joint: the share of it that is seen, and its distance from the observed points."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gepf.common.activation import nearest_in
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Pinhole
from gepf.common.compiling import numba
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.tracking.observation import POINTS, camera_points

REGION_M = 0.12  # standard deviation of the weights of the surface around a joint by distance
AGREES_M = 0.08  # largest difference between the surface and the depth measured there
FARTHEST_M = 0.15  # distance of a point above which it counts the same
FEW = 1.0  # points around a joint that count as nothing
ASIDE_M = 0.03  # radius across the line of sight in which measured depth is searched


def seen_shares(model: BodyModel, pose: Array, subject: SubjectFrame, stretch: float) -> Array:
    """Visible share (C, J) of the surface around each joint of pose (D,) that faces each camera.

    A triangle is visible if the subject's depth was measured at its position. `stretch`, the ratio of lateral
    to depth noise, scales differences of depth.
    """
    vertices, regions = pose_vertices(model, pose[None])[0], regions_of(model)
    areas = np.zeros((len(subject.views), 2, regions.shape[1]))
    for each, seen in zip(subject.views, areas, strict=True):
        frame = each.frame
        add_areas(
            np.ascontiguousarray(frame.to_camera(vertices)),
            model.triangles,
            regions,
            np.array(frame.depth, order="C"),  # a kernel is compiled for one memory layout
            frame.depth_scale,
            frame.intrinsics.pinhole,
            stretch,
            seen,
        )
    return np.asarray(areas[:, 1] / np.maximum(areas[:, 0], np.finfo(float).tiny))


def misfits(model: BodyModel, pose: Array, joints: Array, subject: SubjectFrame, stretch: float) -> Array:
    """Mean distance (J,) in metres of the observed points around each joint (J, 3) from the surface.

    Of pose (D,), with lengths along the line of sight scaled by `stretch`. Distances above OFF count as that.
    """
    vertices = pose_vertices(model, pose[None])[0]
    scale, weights, sums = np.array([1.0, 1.0, stretch]), np.full(len(joints), FEW), np.zeros(len(joints))
    every = max(1, sum(len(each.picked) for each in subject.views) // POINTS)
    for each in subject.views:
        points = camera_points(each, every) * scale
        apart = np.minimum(cKDTree(each.frame.to_camera(vertices) * scale).query(points)[0], FARTHEST_M)
        aside = points[:, None] - each.frame.to_camera(joints) * scale
        near = np.exp(-0.5 * np.sum(aside**2, axis=-1) / REGION_M**2)
        weights += near.sum(axis=0)
        sums += apart @ near
    return np.asarray(sums / weights)


@numba.njit(cache=True, nogil=True)
def add_areas(
    vertices: Array,
    triangles: NDArray[np.integer],
    regions: Array,
    depth: NDArray[np.uint16],
    scale: float,
    lens: Pinhole,
    stretch: float,
    areas: Array,
) -> None:
    """Add the area that faces the camera and its visible part to areas (2, J), with weights (T, J)."""
    middle, normal = np.empty(3), np.empty(3)
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            middle[i] = (a[i] + b[i] + c[i]) / 3.0
            normal[i] = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
        x, y, z = middle
        if z <= 0.0:
            continue
        towards = -(normal[0] * x + normal[1] * y + normal[2] * z)
        if towards <= 0.0:
            continue
        towards /= np.sqrt(x * x + y * y + z * z)
        shown = 1.0 if is_shown(x, y, z, depth, scale, lens, stretch) else 0.0
        for joint in range(regions.shape[1]):
            areas[0, joint] += regions[t, joint] * towards
            areas[1, joint] += regions[t, joint] * towards * shown


@numba.njit(cache=True, nogil=True)
def is_shown(
    x: float, y: float, z: float, depth: NDArray[np.uint16], scale: float, lens: Pinhole, stretch: float
) -> bool:
    """Whether the subject's depth (H, W) was measured at a point or next to it."""
    fx, fy, cx, cy = lens
    for aside in (-ASIDE_M, 0.0, ASIDE_M):
        row = int(np.floor(cy + fy * (y + aside) / z + 0.5))
        if row < 0 or row >= depth.shape[0]:
            continue
        for along in (-ASIDE_M, 0.0, ASIDE_M):
            column = int(np.floor(cx + fx * (x + along) / z + 0.5))
            if column < 0 or column >= depth.shape[1] or depth[row, column] == 0:
                continue
            if abs(depth[row, column] / scale - z) * stretch <= AGREES_M:
                return True
    return False


@lru_cache(maxsize=16)
def regions_of(model: BodyModel) -> Array:
    """The weight of each triangle for each joint (T, J): it is near the joint and on a link at the joint."""
    joints = joint_positions(model, np.zeros((1, len(model.kinds))))[0]
    middles, links = model.vertices[model.triangles].mean(axis=1), model.skin_links[model.triangles[:, 0], 0]
    carried = np.unique(links)
    # the first link with triangles that each degree of freedom moves
    first = {int(model.link_dofs[link]): int(link) for link in carried[::-1]}
    dofs = model.link_dofs.tolist()
    # the nearest degree of freedom above each link that moves one of them
    ends = [d if d < 0 else nearest_in(model, first, int(model.parents[d])) for d in dofs]
    above = np.array([-1 if d < 0 else first.get(end, -1) for d, end in zip(dofs, ends, strict=True)])
    weights = np.zeros((len(links), len(joints)))
    for j, link in enumerate(model.joint_links):
        meet = (links == link) | (links == above[link]) | (above[links] == link)
        near = np.flatnonzero(meet | ~meet.any())
        squares = np.sum((middles[near] - joints[j]) ** 2, axis=1)
        weights[near, j] = np.exp(-0.5 * (squares - squares.min()) / REGION_M**2)
    return weights
