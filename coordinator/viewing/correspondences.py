"""What the reported pose explains, for looking at: each observed point and the nearest point of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from common.camera import back_project
from common.frame import DepthFrame
from coordinator.tracking.observing.isolation import Isolation, PosedBody

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Observed points, the nearest vertices that face the camera, and the distances between them, metres."""

    observed: Array  # (P, 3) in the camera frame
    nearest: Array  # (P, 3)
    residual: Array  # (P,)


def correspond(isolation: Isolation, frame: DepthFrame, body: PosedBody) -> Correspondences | None:
    """For the points of the subject near a body in the next frame; None where nothing of it was seen."""
    subject = isolation.cut(frame, body).subject
    if subject is None:
        return None
    surface = body.surface
    cropped = subject.frame
    observed = back_project(cropped.metres(), cropped.intrinsics).reshape(-1, 3)[subject.picked]
    faced = surface[facing(surface, body.model.triangles)]
    distance, at = KDTree(faced).query(observed)
    return Correspondences(observed, faced[at], distance)


def facing(surface: Array, triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which vertices (V,) belong to a triangle whose outside the camera sees, occlusion aside."""
    corners = surface[triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = np.einsum("ti,ti->t", outward, corners[:, 0]) < 0.0
    seen = np.zeros(len(surface), dtype=np.bool_)
    seen[triangles[towards]] = True
    return seen
