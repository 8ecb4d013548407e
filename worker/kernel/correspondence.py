"""The closest visible model point of each observed point, and the offset from it (step 4c).

The search is exact. Observed points are grouped into tiles, model points into leaves, and leaves into groups.
The points of each are neighbours, so their bounding boxes are small. An initial guess gives an upper bound on
the distance of each observed point: its closest point in the last search, which may be that of another
particle, or a point in the leaf nearest to its tile. The search skips every group and leaf whose box is
farther from a tile's box than the largest bound of the tile. In the leaves that are left it compares points
one by one.

The result does not depend on the guess: bounds are slightly enlarged, so the first of equally close points in
the order of the leaves is always found.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Indices, Numbers, Points
from gepf.common.compiling import numba
from gepf.worker.kernel.observation import TILE, PackedObservation
from gepf.worker.kernel.surface import Surface
from gepf.worker.kernel.tiles import boxes_within, largest_of, lowest_bit, search_lanes
from gepf.worker.kernel.workspace import BLOCK, Search, Workspace

LOOSER, TINY = np.float32(1.0 + 1e-6), np.float32(1e-12)  # enlarge bounds: points at the bound are found


@numba.njit(cache=True, nogil=True)
def find_correspondences(
    visible: Numbers, surface: Surface, observed: PackedObservation, stretch: float, workspace: Workspace
) -> None:
    """Find the closest visible vertex of each observed point, and its offset from the disc around it.

    Fills workspace.search.closest with indices into `visible`, .squared with squared distances in the metric
    of the noise, .heights and .beyond. The initial guess is the result of the last search in this workspace.
    """
    search, leaves = workspace.search, fill_leaves(visible, surface, stretch, workspace)
    fill_discs(visible, surface, stretch, workspace)
    guesses = search.last_visible[: search.last_count[0]]
    if len(guesses) > 0 and not same_vertices(guesses, visible):
        remap_closest(guesses, visible, search.remapped, search.closest)
    closest_points(observed, leaves, len(guesses) > 0, search)
    measure_offsets(observed, search)
    search.last_count[0] = len(visible)
    search.last_visible[: len(visible)] = visible


@numba.njit(cache=True, nogil=True)
def closest_points(observed: PackedObservation, leaves: int, guessed: bool, search: Search) -> None:
    """Find the point of search.model closest to each observed point: its index and squared distance.

    `leaves` is the number of leaves of the model. With a guess, search.closest holds indices into the model.
    """
    groups = bound_leaves(leaves, search)
    if not guessed:
        guess_by_boxes(observed, leaves, search)
    bound_by_guess(observed.points, search)
    search_tiles(observed.points, observed.tiles, groups, search)


@numba.njit(cache=True, nogil=True)
def same_vertices(first: Numbers, second: Numbers) -> bool:
    """Whether two lists hold the same vertices."""
    differences = np.uint32(0)
    for m in range(min(len(first), len(second))):
        differences |= first[m] ^ second[m]
    return len(first) == len(second) and differences == 0


@numba.njit(cache=True, nogil=True)
def fill_leaves(visible: Numbers, surface: Surface, stretch: float, workspace: Workspace) -> int:
    """Fill workspace.search.model with the visible vertices, and .starts; returns the number of leaves."""
    model, starts = workspace.search.model, workspace.search.starts
    posed, leaf_of = workspace.posed, surface.leaves
    leaves, leaf = 0, -1
    for m in range(len(visible)):
        v = visible[m]
        model[m, 0], model[m, 1], model[m, 2] = posed[v, 0], posed[v, 1], posed[v, 2] * stretch
        if leaf_of[v] != leaf:
            leaf = leaf_of[v]
            starts[leaves] = m
            leaves += 1
    starts[leaves] = len(visible)
    return leaves


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_discs(visible: Numbers, surface: Surface, stretch: float, workspace: Workspace) -> None:
    """Fill workspace.search.discs with the normals and radii of the visible vertices."""
    discs, normals, radii = workspace.search.discs, surface.normals, surface.radii
    transforms, link_dofs, links = workspace.transforms, surface.link_dofs, surface.skin_links
    per_stretch = 1.0 / stretch
    for m in range(len(visible)):
        v = visible[m]
        t = transforms[link_dofs[links[v, 0]]]
        a, b, c = normals[v, 0], normals[v, 1], normals[v, 2]
        x = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        y = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        z = per_stretch * (t[2, 0] * a + t[2, 1] * b + t[2, 2] * c)
        scale = 1.0 / np.sqrt(x * x + y * y + z * z)
        discs[m, 0], discs[m, 1], discs[m, 2], discs[m, 3] = scale * x, scale * y, scale * z, radii[v]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def measure_offsets(observed: PackedObservation, search: Search) -> None:
    """Fill search.heights and .beyond with the offsets of the observed points from their vertices' discs.

    Its parts are loops without branches over contiguous rows, which are compiled to vector instructions.
    """
    points, model, discs, block = observed.points, search.model, search.discs, search.block
    x, y, z, nx, ny, nz, radii = block[0], block[1], block[2], block[3], block[4], block[5], block[6]
    for first in range(0, points.shape[1], BLOCK):
        stop = min(first + BLOCK, points.shape[1])
        heights, beyond = search.heights[first:stop], search.beyond[first:stop]
        for i in range(stop - first):
            m, p = np.uint64(search.closest[first + i]), np.uint64(first + i)
            x[i], y[i] = points[0, p] - model[m, 0], points[1, p] - model[m, 1]
            z[i], radii[i] = points[2, p] - model[m, 2], discs[m, 3]
            nx[i], ny[i], nz[i] = discs[m, 0], discs[m, 1], discs[m, 2]
        for i in range(stop - first):
            heights[i] = nx[i] * x[i] + ny[i] * y[i] + nz[i] * z[i]
        for i in range(stop - first):
            h = heights[i]
            ax, ay, az = x[i] - h * nx[i], y[i] - h * ny[i], z[i] - h * nz[i]
            beyond[i] = max(np.float32(0.0), np.sqrt(ax * ax + ay * ay + az * az) - radii[i])


@numba.njit(cache=True, nogil=True)
def remap_closest(before: Numbers, visible: Numbers, remapped: Numbers, closest: Numbers) -> None:
    """Map `closest` from indices into `before` to those of the same or the next vertices in `visible`."""
    place = 0
    for m in range(len(before)):
        while place < len(visible) - 1 and visible[place] < before[m]:
            place += 1
        remapped[m] = place
    for i in range(len(closest)):
        closest[i] = remapped[closest[i]]


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def bounding_boxes(points: Points, starts: Indices, boxes: Points) -> None:
    """Fill boxes (6, K): smallest and largest x, y, z of the points from each start (K + 1,) to the next."""
    for k in range(len(starts) - 1):
        first = np.uint64(starts[k])  # an unsigned index needs no test for negative values
        left, top, front = points[first, 0], points[first, 1], points[first, 2]
        right, bottom, back = left, top, front
        for n in range(1, starts[k + 1] - starts[k]):
            i = first + np.uint64(n)
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            left, right = min(left, x), max(right, x)
            top, bottom = min(top, y), max(bottom, y)
            front, back = min(front, z), max(back, z)
        boxes[0, k], boxes[1, k], boxes[2, k] = left, top, front
        boxes[3, k], boxes[4, k], boxes[5, k] = right, bottom, back


@numba.njit(cache=True, nogil=True)
def guess_by_boxes(observed: PackedObservation, leaves: int, search: Search) -> None:
    """Guess the closest points: those of the leaf whose centre is nearest to the centre of a tile."""
    points, tiles, model, starts = observed.points, observed.tiles, search.model, search.starts
    closest, squared, boxes = search.closest, search.squared, search.leaves
    count = tiles.shape[1]
    padded = (count + TILE - 1) // TILE * TILE
    apart, nearest = np.full(padded, np.float32(np.inf)), np.zeros(padded, np.uint32)
    tile_centres, leaf_centres = np.zeros((3, padded), np.float32), np.empty((leaves, 3), np.float32)
    for a in range(3):
        tile_centres[a, :count] = tiles[a] + tiles[3 + a]  # twice the centre, as for the leaves
        leaf_centres[:, a] = boxes[a, :leaves] + boxes[3 + a, :leaves]
    for t in range(0, padded, TILE):
        search_lanes(tile_centres, t, leaf_centres, 0, leaves, apart, nearest)  # type: ignore[call-arg]
    closest[:] = 0
    squared[:] = np.inf
    for t in range(count):
        k = nearest[t]
        search_lanes(points, t * TILE, model, starts[k], starts[k + 1], squared, closest)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def bound_leaves(leaves: int, search: Search) -> int:
    """Fill the bounding boxes of all leaves and groups; returns the number of groups."""
    boxes, groups = search.leaves, search.groups
    bounding_boxes(search.model, search.starts[: leaves + 1], boxes)
    count = (leaves + TILE - 1) // TILE
    boxes[:, leaves : count * TILE] = np.inf
    groups[:, count:] = np.inf
    for g in range(count):
        for a in range(3):
            low, high = boxes[a, g * TILE], boxes[3 + a, g * TILE]
            for k in range(g * TILE + 1, min(leaves, (g + 1) * TILE)):
                low = min(low, boxes[a, k])
                high = max(high, boxes[3 + a, k])
            groups[a, g], groups[3 + a, g] = low, high
    return count


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def bound_by_guess(observed: Points, search: Search) -> None:
    """Bound squared distances by those of the guesses, slightly enlarged; find the largest of each tile."""
    model, squared, closest, bounds = search.model, search.squared, search.closest, search.largest
    for t in range(len(bounds)):
        largest = np.float32(0.0)
        for i in range(t * TILE, (t + 1) * TILE):
            m = closest[i]
            dx, dy, dz = (
                observed[0, i] - model[m, 0],
                observed[1, i] - model[m, 1],
                observed[2, i] - model[m, 2],
            )
            squared[i] = LOOSER * (dx * dx + dy * dy + dz * dz) + TINY
            largest = max(largest, squared[i])
        bounds[t] = largest


@numba.njit(cache=True, nogil=True)
def search_tiles(observed: Points, tiles: Points, groups: int, search: Search) -> None:
    """Reduce all squared distances to those of the closest points, starting from the bound of each tile."""
    model, starts, squared, closest = search.model, search.starts, search.squared, search.closest
    boxes, around, bounds = search.leaves, search.groups, search.largest
    for t in range(len(bounds)):
        tile, largest = t * TILE, bounds[t]
        for first in range(0, groups, TILE):
            near: int = boxes_within(tiles, t, around, first, largest)  # type: ignore[call-arg]
            while near != 0:
                leaf = (first + lowest_bit(near)) * TILE
                near &= near - 1
                within: int = boxes_within(tiles, t, boxes, leaf, largest)
                while within != 0:
                    k = np.uint64(leaf + lowest_bit(within))
                    within &= within - 1
                    search_lanes(observed, tile, model, starts[k], starts[k + np.uint64(1)], squared, closest)
                largest = largest_of(squared, tile)
