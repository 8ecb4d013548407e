"""How much of the surface around each joint a frame shows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.kinematics import joint_positions, pose_vertices

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

REGION_M = 0.12  # from the joint, one standard deviation of the weights of the surface around it
AGREES_M = 0.08  # between the surface and the depth measured there, up to which that part is seen
ASIDE_M = 0.03  # across the line of sight, within which the measured depth is looked for
CLOSEST_M = 0.1  # depth from the camera


def seen_shares(model: BodyModel, pose: Array, subject: SubjectFrame, stretch: float) -> Array:
    """Share (J,) of the surface around each joint of pose (D,) that a frame shows, of what faces the camera.

    A triangle is shown where the subject's depth was measured at its place. `stretch`, the lateral over the
    depth noise, scales differences of depth.
    """
    corners = pose_vertices(model, pose[None])[0][model.triangles]  # (T, 3, 3)
    middles = corners.mean(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = -np.einsum("ta,ta->t", normals, middles) / np.linalg.norm(middles, axis=1)
    facing = np.flatnonzero((towards > 0.0) & (middles[:, 2] > CLOSEST_M))
    area = regions_of(model)[:, facing] * towards[facing]
    shown = area @ are_shown(middles[facing], subject, stretch)
    shares: Array = shown / np.maximum(area.sum(axis=1), np.finfo(float).tiny)
    return shares


def are_shown(points: Array, subject: SubjectFrame, stretch: float) -> Flags:
    """Where the subject's depth was measured at points (P, 3) or beside them, (P,)."""
    depth, camera = subject.frame.depth, subject.frame.intrinsics
    beside = ASIDE_M * np.array([-1.0, 0.0, 1.0])
    x, y, z = points.T[..., None]
    columns = np.floor(camera.cx + camera.fx * (x + beside) / z + 0.5).astype(int)[:, None, :]
    rows = np.floor(camera.cy + camera.fy * (y + beside) / z + 0.5).astype(int)[:, :, None]
    within = (columns >= 0) & (columns < depth.shape[1]) & (rows >= 0) & (rows < depth.shape[0])
    measured = depth[rows.clip(0, depth.shape[0] - 1), columns.clip(0, depth.shape[1] - 1)]
    agrees = np.abs(measured / subject.frame.depth_scale - z[..., None]) * stretch <= AGREES_M
    shown: Flags = (within & (measured > 0) & agrees).any(axis=(1, 2))
    return shown


@lru_cache(maxsize=16)
def regions_of(model: BodyModel) -> Array:
    """How much each triangle counts for each joint (J, T): near it, and of the links that meet there."""
    joints = joint_positions(model, np.zeros((1, len(model.kinds))))[0]
    middles, links = model.vertices[model.triangles].mean(axis=1), model.skin_links[model.triangles[:, 0], 0]
    carried = np.unique(links)
    above = np.array([link_above(model, link, carried) for link in range(len(model.link_names))])
    weights = np.zeros((len(joints), len(links)))
    for j, link in enumerate(model.joint_links):
        meet = (links == link) | (links == above[link]) | (above[links] == link)
        squares = np.sum((middles - joints[j]) ** 2, axis=1)
        nearest = squares[meet].min() if meet.any() else squares.min()
        weights[j] = np.exp(-0.5 * (squares - nearest) / REGION_M**2) * (meet | ~meet.any())
    return weights


def link_above(model: BodyModel, link: int, carried: NDArray[np.integer]) -> int:
    """The nearest of some links that a link hangs on; -1 for none."""
    dof = int(model.link_dofs[link])
    while dof >= 0:
        dof = int(model.parents[dof])
        found = carried[model.link_dofs[carried] == dof]
        if len(found):
            return int(found[0])
    return -1
