"""Everything that the refinement of a particle writes to, allocated once and used again.

Nothing passes from one particle to the next: all is written before it is read.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worker.kernel.neighbourhoods import BLOCK, TILE
from worker.kernel.observation import PackedObservation
from worker.kernel.surface import Skeleton, Surface

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

LARGEST_SIDE = 512  # pixels of a depth buffer
ROW_PADDING = 3  # pixels at the end of each row of a depth buffer, in which nothing is
LARGEST_RADIUS = 3  # pixels around an observed point in which its samples lie (soft correspondences)
SIDE = 2 * LARGEST_RADIUS + 1


class VisibilityBuffers(NamedTuple):
    """A surface in a pose, and its depth buffer."""

    posed: Array  # (V, 3) metres, camera frame
    image: Array  # (V, 2) pixels of the depth buffer
    front: NDArray[np.bool_]  # (V,) part of a triangle that faces us
    buffer: Points  # (LARGEST_SIDE * (LARGEST_SIDE + ROW_PADDING),)
    visible: Numbers  # (V,)


class SearchBuffers(NamedTuple):
    """The visible vertices by leaf, and the closest of them to each observed point."""

    model: Points  # (V, 3) visible points
    last_visible: Numbers  # (V,) the vertices of the last search
    remapped: Numbers  # (V,) their places among the visible ones now
    starts: Indices  # (K + 1,) where their leaves begin, and the last ends
    leaves: Points  # (6, K) bounding boxes, padded to whole tiles with what is infinitely far
    groups: Points  # (6, K / TILE) those of TILE leaves in a row, padded alike
    centre_distances: Points  # (K,) squared distances of the leaves' centres
    closest: Numbers  # (P,) which of them; what the last search found is the guess of the next
    squared: Points  # (P,)
    largest: Points  # (P / TILE,) of a tile's
    weights: Array  # (P,)


class NormalEquations(NamedTuple):
    """The sums over correspondences, and Eq. 4."""

    sums: Array  # (L, 4, 8) both of the following in a row, as they are summed up
    moments: Array  # (L, 4, 4)
    crosses: Array  # (L, 4, 3)
    reference: Array  # (D, 3, 4) T_camera_rest where the sums were taken
    moved: Array  # (D, 3, 4) T_camera_rest now
    w: Array  # (D, 3) axes of relative motion
    q: Array  # (D, 3) points on them
    subtree_m: Array  # (D, 4, 4)
    subtree_c: Array  # (D, 4, 3)
    columns: Array  # (D, 3, 4)
    gram: Array  # (D, D)
    information: Array  # (D, D) the last step's gram, before it is damped and limits hold
    gradient: Array  # (D,)
    step: Array  # (D,)


class Rays(NamedTuple):
    """Observed points of a block as the camera measured them."""

    right: Array  # (BLOCK,) of the ray, for each metre of depth
    down: Array  # (BLOCK,)
    depth: Points  # (BLOCK,) metres
    column: Indices  # (BLOCK,) of the first sample around the point
    row: Indices  # (BLOCK,)
    place: Numbers  # (BLOCK,) of that sample, among all


class SoftBuffers(NamedTuple):
    """The samples of a pose, those around a block of points, and one point's wrench on each link."""

    depth: Points  # (LARGEST_SIDE ** 2,)
    sampled_links: NDArray[np.int32]  # (LARGEST_SIDE ** 2,)
    rays: Rays
    across: Points  # (2, SIDE, BLOCK) squared samples by which a ray passes by columns and rows
    densities: Points  # (SIDE ** 2, BLOCK) p_k(p_i), samples row by row
    totals: Points  # (BLOCK,) their sums
    wrenches: Array  # (L, 6) force, and torque about the camera
    links: Indices  # (L,) that the point acts on
    touched: NDArray[np.bool_]  # (L,)
    score: Array  # (D,)


class Workspace(NamedTuple):
    """Buffers for the refinement of a particle."""

    transforms: Array  # (D + 1, 3, 4) T_camera_rest, the last for links that nothing moves
    weighted_targets: Array  # (V, 4) of visible vertices: weighted sum of observed points, weight
    silhouette_points: Array  # (V, 4) nearest to visible vertices that lie beside the silhouette, weight
    silhouette_squared: Array  # (V,) squared distances from them, m^2
    visibility: VisibilityBuffers
    search: SearchBuffers
    equations: NormalEquations
    soft: SoftBuffers


def make_workspace(skeleton: Skeleton, surface: Surface, observed: PackedObservation) -> Workspace:
    """Allocate a workspace for particles of one body and one observation."""
    dofs, links, vertices = len(skeleton.parents), len(skeleton.link_dofs), len(surface.vertices)
    return Workspace(
        transforms=np.tile(np.eye(4)[:3], (dofs + 1, 1, 1)),
        weighted_targets=np.empty((vertices, 4)),
        silhouette_points=np.empty((vertices, 4)),
        silhouette_squared=np.empty(vertices),
        visibility=make_visibility_buffers(vertices),
        search=make_search_buffers(observed.points.shape[1], vertices, surface.leaves[-1] + 1),
        equations=make_equations(dofs, links),
        soft=make_soft_buffers(dofs, links),
    )


def make_visibility_buffers(vertices: int) -> VisibilityBuffers:
    """Allocate buffers for a surface of so many vertices."""
    return VisibilityBuffers(
        posed=np.empty((vertices, 3)),
        image=np.empty((vertices, 2)),
        front=np.empty(vertices, np.bool_),
        buffer=np.empty(LARGEST_SIDE * (LARGEST_SIDE + ROW_PADDING), np.float32),
        visible=np.empty(vertices, np.uint32),
    )


def make_search_buffers(points: int, vertices: int, leaves: int) -> SearchBuffers:
    """Allocate buffers for so many observed points, padded, model points and leaves."""
    groups = -(-leaves // TILE)
    return SearchBuffers(
        model=np.empty((vertices, 3), np.float32),
        last_visible=np.empty(vertices, np.uint32),
        remapped=np.empty(vertices, np.uint32),
        starts=np.empty(leaves + 1, np.int64),
        leaves=np.empty((6, groups * TILE), np.float32),
        groups=np.empty((6, -(-groups // TILE) * TILE), np.float32),
        centre_distances=np.empty(leaves, np.float32),
        closest=np.empty(points, np.uint32),
        squared=np.empty(points, np.float32),
        largest=np.empty(points // TILE, np.float32),
        weights=np.empty(points),
    )


def make_equations(dofs: int, links: int) -> NormalEquations:
    """Allocate buffers for a body of so many degrees of freedom and links."""
    return NormalEquations(
        sums=np.empty((links, 4, 8)),
        moments=np.empty((links, 4, 4)),
        crosses=np.empty((links, 4, 3)),
        reference=np.empty((dofs, 3, 4)),
        moved=np.empty((dofs, 3, 4)),
        w=np.empty((dofs, 3)),
        q=np.empty((dofs, 3)),
        subtree_m=np.empty((dofs, 4, 4)),
        subtree_c=np.empty((dofs, 4, 3)),
        columns=np.empty((dofs, 3, 4)),
        gram=np.empty((dofs, dofs)),
        information=np.empty((dofs, dofs)),
        gradient=np.empty(dofs),
        step=np.empty(dofs),
    )


def make_soft_buffers(dofs: int, links: int) -> SoftBuffers:
    """Allocate buffers for a body of so many degrees of freedom and links."""
    return SoftBuffers(
        depth=np.empty(LARGEST_SIDE * LARGEST_SIDE, np.float32),
        sampled_links=np.empty(LARGEST_SIDE * LARGEST_SIDE, np.int32),
        rays=Rays(
            right=np.empty(BLOCK),
            down=np.empty(BLOCK),
            depth=np.empty(BLOCK, np.float32),
            column=np.empty(BLOCK, np.int64),
            row=np.empty(BLOCK, np.int64),
            place=np.empty(BLOCK, np.uint32),
        ),
        across=np.empty((2, SIDE, BLOCK), np.float32),
        densities=np.empty((SIDE * SIDE, BLOCK), np.float32),
        totals=np.empty(BLOCK, np.float32),
        wrenches=np.empty((links, 6)),
        links=np.empty(links, np.int64),
        touched=np.zeros(links, np.bool_),
        score=np.empty(dofs),
    )


def narrow(workspace: Workspace, points: int) -> Workspace:
    """The same workspace for fewer observed points (padded) than it was allocated for."""
    search = workspace.search
    return workspace._replace(
        search=search._replace(
            closest=search.closest[:points],
            squared=search.squared[:points],
            largest=search.largest[: points // TILE],
            weights=search.weights[:points],
        )
    )
