"""Everything that the descent of a particle writes to, allocated once for a batch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worker.kernel.observation import TILE
from worker.kernel.packing import PackedObservation
from worker.kernel.search.correspondence import SearchBuffers, make_search_buffers
from worker.kernel.soft.responsibilities import SoftBuffers, make_soft_buffers
from worker.kernel.soft.samples import SampleBuffers, make_sample_buffers
from worker.kernel.solver.normal_equations import NormalEquations, make_equations
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.visibility import VisibilityBuffers, make_visibility_buffers

Array = NDArray[np.float64]


class Workspace(NamedTuple):
    """Buffers for the descent of a particle.

    Nothing passes from one particle to the next: all is written before it is read.
    """

    transforms: Array  # (D + 1, 3, 4) T_camera_rest, the last for links that nothing moves
    weighted_targets: Array  # (V, 4) of visible vertices: weighted sum of observed points, weight
    silhouette_points: Array  # (V, 4) nearest to visible vertices that lie beside the silhouette, weight
    silhouette_squared: Array  # (V,) squared distances from them, m^2
    visibility: VisibilityBuffers
    search: SearchBuffers
    equations: NormalEquations
    samples: SampleBuffers
    soft: SoftBuffers


def make_workspace(skeleton: Skeleton, surface: Surface, observed: PackedObservation) -> Workspace:
    """Allocate a workspace for particles of one body and one observation."""
    dofs, vertices = len(skeleton.parents), len(surface.vertices)
    return Workspace(
        np.tile(np.eye(4)[:3], (dofs + 1, 1, 1)),
        np.empty((vertices, 4)),
        np.empty((vertices, 4)),
        np.empty(vertices),
        make_visibility_buffers(vertices),
        make_search_buffers(observed.points.shape[1], vertices, surface.leaves[-1] + 1),
        make_equations(dofs, len(skeleton.link_dofs)),
        make_sample_buffers(),
        make_soft_buffers(dofs, len(skeleton.link_dofs)),
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
