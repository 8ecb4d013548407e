"""The visible share of the surface around each joint."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.activation import nearest_in
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Pinhole
from gepf.common.compiling import numba
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.settings import CertaintySettings


class Tolerance(NamedTuple):
    """When measured depth agrees with a surface."""

    agrees_m: float  # largest difference of depth, after multiplication by `stretch`
    stretch: float
    aside_m: float  # radius across the line of sight


def seen_shares(
    model: BodyModel, pose: Array, subject: SubjectFrame, stretch: float, settings: CertaintySettings
) -> Array:
    """Visible share (C, J) of the surface around each joint of pose (D,) that faces each camera.

    A triangle is visible if the subject's depth was measured at its position. `stretch`, the ratio of lateral
    to depth noise, scales differences of depth.
    """
    vertices, regions = pose_vertices(model, pose[None])[0], regions_of(model, settings.region_m)
    tolerance = Tolerance(settings.agrees_m, stretch, settings.aside_m)
    areas = np.zeros((len(subject.views), 2, regions.shape[1]))
    for view, seen in zip(subject.views, areas, strict=True):
        frame = view.frame
        add_areas(
            np.ascontiguousarray(frame.to_camera(vertices)),
            model.triangles,
            regions,
            np.array(frame.depth, order="C"),  # a kernel is compiled for one memory layout
            frame.depth_scale,
            frame.intrinsics.pinhole,
            tolerance,
            seen,
        )
    return np.asarray(areas[:, 1] / np.maximum(areas[:, 0], np.finfo(float).tiny))


@numba.njit(cache=True, nogil=True)
def add_areas(
    vertices: Array,
    triangles: NDArray[np.integer],
    regions: Array,
    depth: NDArray[np.uint16],
    scale: float,
    lens: Pinhole,
    tolerance: Tolerance,
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
        shown = 1.0 if is_shown(x, y, z, depth, scale, lens, tolerance) else 0.0
        for joint in range(regions.shape[1]):
            areas[0, joint] += regions[t, joint] * towards
            areas[1, joint] += regions[t, joint] * towards * shown


@numba.njit(cache=True, nogil=True)
def is_shown(
    x: float, y: float, z: float, depth: NDArray[np.uint16], scale: float, lens: Pinhole, tolerance: Tolerance
) -> bool:
    """Whether the subject's depth (H, W) was measured at a point or next to it."""
    aside_m = tolerance.aside_m
    fx, fy, cx, cy = lens
    for aside in (-aside_m, 0.0, aside_m):
        row = int(np.floor(cy + fy * (y + aside) / z + 0.5))
        if row < 0 or row >= depth.shape[0]:
            continue
        for along in (-aside_m, 0.0, aside_m):
            column = int(np.floor(cx + fx * (x + along) / z + 0.5))
            if column < 0 or column >= depth.shape[1] or depth[row, column] == 0:
                continue
            if abs(depth[row, column] / scale - z) * tolerance.stretch <= tolerance.agrees_m:
                return True
    return False


@lru_cache(maxsize=16)
def regions_of(model: BodyModel, region_m: float) -> Array:
    """The weight of each triangle for each joint (T, J): it is near the joint and on a link at the joint.

    `region_m` is the standard deviation of the weight by distance, metres.
    """
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
        weights[near, j] = np.exp(-0.5 * (squares - squares.min()) / region_m**2)
    return weights
