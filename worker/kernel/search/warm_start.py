"""Correspondences of a particle, each search warm-started from the one before (step 4c).

The closest points of the last search are the guess that bounds the next one. Where visibility was updated in
between, they are mapped to the new set of visible vertices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.packing import KernelParameters, PackedObservation
from worker.kernel.search.correspondence import closest_points, closest_points_from_guess
from worker.kernel.surface import Surface
from worker.kernel.workspace import Workspace

Numbers = NDArray[np.uint32]  # of vertices


@numba.njit(cache=True, nogil=True)
def find_correspondences(
    visible: Numbers,
    last_count: int,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> int:
    """Find the closest visible vertex of each observed point; returns how many vertices were searched.

    Fills workspace.search.closest with places in `visible` and .squared with squared distances, depth
    stretched. `last_count` is what the particle's last search returned, which warm-starts this one; 0 for
    the first.
    """
    search, leaves = workspace.search, fill_leaves(visible, surface, parameters, workspace)
    if last_count == 0:
        closest_points(observed.points, observed.blocks, observed.tiles, leaves, search)
    else:
        if not same_vertices(search.last_visible[:last_count], visible):
            remap_closest(search.last_visible[:last_count], visible, search.remapped, search.closest)
        closest_points_from_guess(observed.points, observed.tiles, leaves, search)
    search.last_visible[: len(visible)] = visible
    return len(visible)


@numba.njit(cache=True, nogil=True)
def same_vertices(some: Numbers, others: Numbers) -> bool:
    """Whether these are the same vertices."""
    differences = np.uint32(0)
    for m in range(min(len(some), len(others))):
        differences |= some[m] ^ others[m]
    return len(some) == len(others) and differences == 0


@numba.njit(cache=True, nogil=True)
def fill_leaves(
    visible: Numbers, surface: Surface, parameters: KernelParameters, workspace: Workspace
) -> int:
    """Fill workspace.search.model with the visible vertices and .starts by leaf; returns how many leaves."""
    model, starts = workspace.search.model, workspace.search.starts
    posed, leaf_of = workspace.visibility.posed, surface.leaves
    leaves, leaf = 0, -1
    for m in range(len(visible)):
        v = visible[m]
        model[m, 0], model[m, 1], model[m, 2] = posed[v, 0], posed[v, 1], posed[v, 2] * parameters.stretch
        if leaf_of[v] != leaf:
            leaf = leaf_of[v]
            starts[leaves] = m
            leaves += 1
    starts[leaves] = len(visible)
    return leaves


@numba.njit(cache=True, nogil=True)
def remap_closest(before: Numbers, visible: Numbers, remapped: Numbers, closest: Numbers) -> None:
    """Map `closest` from places in `before` to those of the same vertices in `visible`, or of the next."""
    place = 0
    for m in range(len(before)):
        while place < len(visible) - 1 and visible[place] < before[m]:
            place += 1
        remapped[m] = place
    for i in range(len(closest)):
        closest[i] = remapped[closest[i]]
