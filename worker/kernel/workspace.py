"""Arrays for the refinement of a particle, allocated once for many particles.

Only the closest points of one particle pass to the next, as the initial guess of its first search, which
does not change the result. Everything else is written before it is read.

Cameras have their own closest points, visible vertices and sums; all else holds the camera that was computed
last.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Indices, Mask, Numbers, Points
from gepf.common.compiling import numba
from gepf.worker.kernel.drawing import SIDE
from gepf.worker.kernel.observation import TILE, PackedObservation, PackedViews
from gepf.worker.kernel.parameters import KernelParameters, Weights
from gepf.worker.kernel.surface import Skeleton, Surface

LARGEST_SIDE_PX = 512  # of a depth image
BLOCK = 16 * TILE  # observed points


class Keypoints(NamedTuple):
    """The keypoints of a body at rest."""

    links: Indices  # (K,)
    points: Array  # (K, 3)


class Problem(NamedTuple):
    """What all particles of a request share: the body, the frame, and how they are refined."""

    skeleton: Skeleton
    surface: Surface
    views: PackedViews
    parameters: KernelParameters
    keypoints: Keypoints
    precision: Array  # (D, D) of the prior of the pose, nats per squared radian or metre; (0, 0) without
    elimination: Indices  # (D,) parents in the elimination tree of the normal equations


class Search(NamedTuple):
    """The visible vertices by leaf, and the closest of them to each observed point."""

    model: Points  # (V, 3) visible vertices, depth stretched
    discs: Points  # (V, 4) normals of length 1 and radii of the discs around them, depth stretched
    last_count: Indices  # (1,) number of vertices of the last search; 0 before the first
    last_visible: Numbers  # (V,) these vertices
    remapped: Numbers  # (V,) their indices among the visible ones now
    starts: Indices  # (K + 1,) starts of the leaves, and end of the last
    leaves: Points  # (6, K) bounding boxes, padded to whole tiles with infinitely distant ones
    groups: Points  # (6, K / TILE) bounding boxes of TILE successive leaves, padded likewise
    closest: Numbers  # (P,) indices into `model` of the closest points; guess of the next search
    squared: Points  # (P,)
    largest: Points  # (P / TILE,) the largest of `squared` in each tile
    heights: Points  # (P,) of the observed points over the planes of their closest vertices' discs
    beyond: Points  # (P,) distances of their projections to these planes from the rims; 0 within the discs
    block: Points  # (7, BLOCK) intermediate results for some of the points: few enough for a small cache


class Equations(NamedTuple):
    """Gradient and Gauss-Newton matrix of all terms (Eq. 4): of links, and of degrees of freedom."""

    sums: Array  # (C, L, 4, 8) M, C and zeros of each link, side by side; see `link_sums`
    turns: Array  # (C, 3, 3) rotations of the rig into the cameras
    links: Array  # (L, 6 + S, 7 + S) matrix and wrench of each link, side by side; see `normal_equations`
    twists: Array  # (D, 6 + S) about the rig's origin
    drifts: Array  # (D + 1, S, 3), see `shape`
    fields: Array  # (S, 3, 4) of one link, see `shape`
    subtrees: Array  # (D, 6 + S, 7 + S) totals over all links that a degree of freedom moves
    scratch: Array  # (4, 3, 4) of one link
    gram: Array  # (D, D)
    gradient: Array  # (D,)
    information: Array  # (D, D) gram of the last step, before damping and limits


class Workspace(NamedTuple):
    """Arrays for the refinement of a particle, for one camera."""

    transforms: Array  # (D + 1, 3, 4) T_camera_rest, the last for links that nothing moves
    of_rig: Array  # (D + 1, 3, 4) T_rig_rest, at the time of the frame, with the same last entry
    of_links: Array  # (L, 3, 4) of_rig of each link, after the change of its rest pose by shape
    points: Array  # (D, 3) of the degrees of freedom at rest, in the shape of the pose
    T_camera_rig: Array  # (3, 4)
    step: Array  # (D,) motion from the time of the frame to that of the camera
    posed: Array  # (V, 3) metres, camera frame
    image: Array  # (V, 2) pixels of the depth image
    front: Mask  # (V,) part of a triangle that faces the camera
    visible: Numbers  # (V,)
    depth: Points  # buffer for the largest depth image
    seen_triangles: Numbers
    targets: Array  # (V, 4) of each visible vertex: weighted sum of targets, weight
    free: Numbers  # (V,) indices of the visible vertices in free space
    offsets: Array  # (V, 2) of these, see `vertices_in_free_space`
    search: Search
    sums: Array  # (L, 4, 8) of this camera, part of the equations
    equations: Equations
    wrenches: Array  # (L, 7) of one point, see `fill_wrenches`


class CameraView(NamedTuple):
    """The body posed before a camera: all that the terms of points are computed from."""

    visible: Numbers  # vertices
    observed: PackedObservation
    weights: Weights
    problem: Problem
    workspace: Workspace


class Workspaces(NamedTuple):
    """The workspaces of all cameras; see `workspace_of`."""

    shared: Workspace  # arrays that each camera overwrites
    counts: Indices  # (C,) number of visible vertices
    visible: Numbers  # (C, V)
    last_counts: Indices  # (C, 1) numbers of vertices of the last search
    last_visible: Numbers  # (C, V)
    closest: Numbers  # (P,) of all cameras, one after another
    steps: Array  # (C, D)


def make_workspaces(
    skeleton: Skeleton, surface: Surface, views: PackedViews, velocity: Array | None = None
) -> Workspaces:
    """Allocate workspaces for particles of one body, all with the velocity (D,), and the views of a frame."""
    cameras, vertices = len(views.extents), len(surface.vertices)
    moving = np.zeros(len(skeleton.parents)) if velocity is None else velocity
    return Workspaces(
        shared=allocate(skeleton, surface, int(views.extents[:, 1].max()), views.T_camera_rig),
        counts=np.zeros(cameras, np.int64),
        visible=np.empty((cameras, vertices), np.uint32),
        last_counts=np.zeros((cameras, 1), np.int64),
        last_visible=np.empty((cameras, vertices), np.uint32),
        closest=np.empty(int(views.extents[:, 1].sum()), np.uint32),
        steps=np.outer(views.lenses[:, 4], moving),
    )


@numba.njit(cache=True, nogil=True)
def workspace_of(workspaces: Workspaces, views: PackedViews, v: int) -> Workspace:
    """The workspace of one camera."""
    shared, place, count = workspaces.shared, views.extents[v, 0], views.extents[v, 1]
    search = shared.search
    return Workspace(
        shared.transforms,
        shared.of_rig,
        shared.of_links,
        shared.points,
        views.T_camera_rig[v],
        workspaces.steps[v],
        shared.posed,
        shared.image,
        shared.front,
        workspaces.visible[v],
        shared.depth,
        shared.seen_triangles,
        shared.targets,
        shared.free,
        shared.offsets,
        Search(
            search.model,
            search.discs,
            workspaces.last_counts[v],
            workspaces.last_visible[v],
            search.remapped,
            search.starts,
            search.leaves,
            search.groups,
            workspaces.closest[place : place + count],
            search.squared[:count],
            search.largest[: count // TILE],
            search.heights[:count],
            search.beyond[:count],
            search.block,
        ),
        shared.equations.sums[v],
        shared.equations,
        shared.wrenches,
    )


def allocate(skeleton: Skeleton, surface: Surface, points: int, T_camera_rig: Array) -> Workspace:
    """Allocate a workspace for at most `points` points of each camera; T_camera_rig (C, 3, 4)."""
    dofs, links, vertices = len(skeleton.parents), len(skeleton.link_dofs), len(surface.vertices)
    shapes = len(surface.shape_vertices)
    sums = np.empty((len(T_camera_rig), links, 4, 8))
    return Workspace(
        transforms=np.tile(np.eye(4)[:3], (dofs + 1, 1, 1)),
        of_rig=np.tile(np.eye(4)[:3], (dofs + 1, 1, 1)),
        of_links=np.zeros((links, 3, 4)),
        points=np.empty_like(skeleton.points),
        T_camera_rig=np.ascontiguousarray(T_camera_rig[0]),
        step=np.zeros(dofs),
        posed=np.empty((vertices, 3)),
        image=np.empty((vertices, 2)),
        front=np.empty(vertices, np.bool_),
        visible=np.empty(vertices, np.uint32),
        depth=np.empty((LARGEST_SIDE_PX + SIDE - 1) ** 2, np.float32),
        seen_triangles=np.empty((LARGEST_SIDE_PX + SIDE - 1) ** 2, np.uint32),
        targets=np.empty((vertices, 4)),
        free=np.empty(vertices, np.uint32),
        offsets=np.empty((vertices, 2)),
        search=make_search(vertices, surface.leaves[-1] + 1, points),
        sums=sums[0],
        equations=Equations(
            sums=sums,
            turns=np.ascontiguousarray(T_camera_rig[:, :, :3]),
            links=np.zeros((links, 6 + shapes, 7 + shapes)),
            twists=np.zeros((dofs, 6 + shapes)),
            drifts=np.zeros((dofs + 1, shapes, 3)),
            fields=np.empty((shapes, 3, 4)),
            subtrees=np.empty((dofs, 6 + shapes, 7 + shapes)),
            scratch=np.empty((4, 3, 4)),
            gram=np.empty((dofs, dofs)),
            gradient=np.empty(dofs),
            information=np.empty((dofs, dofs)),
        ),
        wrenches=np.empty((links, 7)),
    )


def make_search(vertices: int, leaves: int, points: int) -> Search:
    """Allocate the arrays of the closest-point search for these numbers of vertices and padded points."""
    groups = -(-leaves // TILE)
    return Search(
        model=np.empty((vertices, 3), np.float32),
        discs=np.empty((vertices, 4), np.float32),
        last_count=np.zeros(1, np.int64),
        last_visible=np.empty(vertices, np.uint32),
        remapped=np.empty(vertices, np.uint32),
        starts=np.empty(leaves + 1, np.int64),
        leaves=np.empty((6, groups * TILE), np.float32),
        groups=np.empty((6, -(-groups // TILE) * TILE), np.float32),
        closest=np.empty(points, np.uint32),
        squared=np.empty(points, np.float32),
        largest=np.empty(points // TILE, np.float32),
        heights=np.empty(points, np.float32),
        beyond=np.empty(points, np.float32),
        block=np.empty((7, BLOCK), np.float32),
    )
