"""The log posterior of a pose in a frame (step 5): minus the sum of the costs of all terms, in nats.

The paper says only "calculated from the residual error". The refinement minimises the same sum (see
`terms`), with fixed correspondences and visible points in each step. For the weight both are computed again
at the final pose. Errors of neighbouring points are correlated: the sum over ten thousand points would leave
only one hypothesis. So all points together count as their mean does (`parameters.Weights`).
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.worker.kernel import terms
from gepf.worker.kernel.correspondence import find_correspondences
from gepf.worker.kernel.observation import view_of
from gepf.worker.kernel.terms import depth
from gepf.worker.kernel.visibility import pose_body, visible_vertices
from gepf.worker.kernel.workspace import CameraView, Problem, Workspaces, workspace_of


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(pose: Array, mean: Array, problem: Problem, workspaces: Workspaces) -> tuple[float, float]:
    """Log posterior of pose (D,), and mean distance of the observed points from the model in metres.

    `mean` (D,) is that of the prior. Visible points are computed at this pose.
    """
    skeleton, surface, views, parameters = (
        problem.skeleton,
        problem.surface,
        problem.views,
        problem.parameters,
    )
    cost, residual, explained = terms.cost_of_pose(pose, mean, problem), 0.0, 0
    for v in range(len(views.extents)):
        observed, workspace = view_of(views, v), workspace_of(workspaces, views, v)
        if observed.count == 0:
            continue
        pose_body(pose, skeleton, surface, workspace)
        visible = visible_vertices(surface, workspace)
        view = CameraView(visible, observed, parameters.posterior, problem, workspace)
        if len(visible) > 0:
            explained += observed.count
            find_correspondences(visible, surface, observed, parameters.stretch, workspace)
            residual += depth.sum_distances(view) / views.total
        cost += terms.cost_of_points(view)
    if explained == 0:
        return -np.inf, np.inf
    return -cost, residual
