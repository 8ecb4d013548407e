"""How far the hypotheses of a frame lie from what was reported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.track import Track


def deviation(track: Track) -> NDArray[np.float64]:
    """Root mean square distance (F, D) of the hypotheses from the reported pose, by weight; metres, radians.

    Zero where a frame ended with one hypothesis: it tells where else the body may be, not how exactly the
    reported pose is known.
    """
    away = track.hypothesis_pose - track.pose[:, None, :]
    turning = np.array([name not in ROOT_DOFS[:3] for name in track.dof_names])
    away[..., turning] = (away[..., turning] + np.pi) % (2.0 * np.pi) - np.pi
    weight = np.nan_to_num(track.hypothesis_weight)
    squares = np.einsum("fm,fmd->fd", weight, np.nan_to_num(away) ** 2)
    total = weight.sum(axis=1, keepdims=True)
    spread: NDArray[np.float64] = np.sqrt(squares / np.where(total > 0.0, total, 1.0))
    return spread
