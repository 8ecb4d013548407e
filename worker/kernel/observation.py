"""From a depth frame to the observed points of section 4.1, in an order that suits the closest-point search.

Done once per frame and shared by all its particles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.compiling import numba
from common.frame import EMPTY, UNMEASURED, SubjectFrame
from worker.kernel.search.neighbourhoods import neighbourhoods
from worker.kernel.silhouette import nearest_occupied_pixels

TILE = 16  # points that are searched for together
BLOCK = 64  # points that share a list of candidates


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Observed points in the camera frame, neighbours together, padded to whole blocks by repeating the last.

    emptiness: how surely the body is not there: 0 where it may be seen or hidden, 1 where it cannot be.
    nearest: for each pixel the nearest one (row, column) whose emptiness is 0.
    """

    points: NDArray[np.float32]  # (blocks * BLOCK, 3)
    count: int  # points that are not padding
    emptiness: NDArray[np.float32]  # (H, W)
    nearest: NDArray[np.int32]  # (2, H, W)
    camera: Intrinsics
    view: NDArray[np.int64]  # (4,)


def observe(subject: SubjectFrame) -> Observation:
    """Observed points of the picked pixels of a frame."""
    depth = subject.frame.metres()
    emptiness = tell_emptiness(subject)
    points = pick_points(depth, subject.picked, subject.frame.intrinsics)
    ordered = points.astype(np.float32)[neighbourhoods(points, TILE, BLOCK)]
    return Observation(
        points=pad_to_blocks(ordered),
        count=len(points),
        emptiness=emptiness,
        nearest=nearest_occupied_pixels(emptiness == 0.0),
        camera=subject.frame.intrinsics,
        view=np.array(subject.view, dtype=np.int64),
    )


def tell_emptiness(subject: SubjectFrame) -> NDArray[np.float32]:
    """How surely the subject is not in each pixel (H, W) of a frame."""
    empty = subject.frame.depth == 0 if subject.kinds is None else subject.kinds == EMPTY
    emptiness = np.where(empty, np.float32(1.0), np.float32(0.0))
    if subject.kinds is not None:
        emptiness[subject.kinds == UNMEASURED] = subject.emptiness
    return emptiness


def pick_points(
    depth: NDArray[np.float32], picked: NDArray[np.uint32], camera: Intrinsics
) -> NDArray[np.float64]:
    """Camera-frame points (P, 3) of the picked pixels."""
    points = np.empty((len(picked), 3))
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    back_project_some(depth.ravel(), depth.shape[1], picked, lens, points)
    return points


@numba.njit(cache=True, nogil=True)
def back_project_some(
    depth: NDArray[np.float32],
    width: int,
    picked: NDArray[np.uint32],
    lens: tuple[float, float, float, float],
    points: NDArray[np.float64],
) -> None:
    """Fill points (P, 3) with the picked pixels' of a depth row by row; the lens is fx, fy, cx, cy."""
    fx, fy, cx, cy = lens
    for i in range(len(picked)):
        v, u = picked[i] // width, picked[i] % width
        z = np.float64(depth[picked[i]])
        points[i, 0], points[i, 1], points[i, 2] = (u - cx) / fx * z, (v - cy) / fy * z, z


def pad_to_blocks(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Points filled up to whole blocks with copies of the last."""
    missing = -len(points) % BLOCK
    return np.concatenate([points, np.repeat(points[-1:], missing, axis=0)])
