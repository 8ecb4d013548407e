"""Parts of a picture that hang together in depth, and what each measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import back_project
from common.compiling import numba
from coordinator.scene.noise import step_at
from coordinator.scene.ransac import segment_plane
from coordinator.scene.room.marks import Depth
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_AREA = 0.008  # square metres of what is looked at
EXTREMES = (1.0, 50.0, 99.0)  # per cent, between which an extent is taken, and the middle
SAMPLED = 800  # points that extents and planes are taken from
PLANE_ROUNDS = 100
UP_STEP = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A part of a picture, with measures in metres and square metres.

    inside: (h, w) its pixels in a window whose first row and column are top and left.
    """

    inside: Mask
    top: int
    left: int
    points: Array  # (P, 3) camera frame
    area: float
    compact: float  # share of its pixels that are surrounded by others of it
    low: Array  # (3,) across, up, and away along the floor: the least
    high: Array  # (3,) and the greatest
    middle: Array  # (3,) in the same directions: the median

    @property
    def size(self) -> Array:
        """Extents (3,) across, up, and away."""
        return self.high - self.low

    @property
    def longest(self) -> float:
        """The greatest extent in any of the three directions."""
        return float(self.size.max())

    def mask(self, view: SceneView) -> Mask:
        """The pixels in the whole picture (H, W)."""
        whole = np.zeros(view.depth.shape, dtype=np.bool_)
        height, width = self.inside.shape
        whole[self.top : self.top + height, self.left : self.left + width] = self.inside
        return whole


def components(view: SceneView, foreground: Mask) -> list[Component]:
    """What hangs together in the foreground (H, W), from the top of the picture on."""
    labels = np.zeros(view.depth.shape, dtype=np.int32)
    count = label(view.depth, foreground, view.noise.growth, labels)
    windows, areas = np.empty((count + 1, 4), dtype=np.int64), np.zeros(count + 1)
    enclose(labels, view.depth, windows, areas)
    areas /= view.camera.fx * view.camera.fy
    found = []
    for n in np.flatnonzero(areas > LEAST_AREA).tolist():
        top, left, bottom, right = windows[n].tolist()
        found.append(measure(view, labels[top:bottom, left:right] == n, top, left))
    return found


def measure(view: SceneView, inside: Mask, top: int, left: int) -> Component:
    """A part of the picture with its measures; inside (h, w) are its pixels in a window there."""
    height, width = inside.shape
    window = view.depth[top : top + height, left : left + width]
    points = back_project(window, view.camera.crop(left, top, width, height))[inside]
    some = points[:: 1 + len(points) // SAMPLED] @ directions(view).T
    low, middle, high = np.percentile(some, EXTREMES, axis=0)
    area = float(points[:, 2] @ points[:, 2]) / (view.camera.fx * view.camera.fy)
    padded = np.pad(inside, 1)
    core = inside & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    compact = float(core.sum() / inside.sum())
    return Component(inside, top, left, points, area, compact, low, high, middle)


def united(view: SceneView, one: Component, other: Component) -> Component:
    """Two parts as one."""
    both = one.mask(view) | other.mask(view)
    rows, columns = np.flatnonzero(both.any(axis=1)), np.flatnonzero(both.any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    return measure(view, both[top : rows[-1] + 1, left : columns[-1] + 1], top, left)


def directions(view: SceneView) -> Array:
    """Rows across, up, and away from the camera along the floor (3, 3)."""
    across = np.cross(view.up, np.array([0.0, 0.0, 1.0]))
    if np.linalg.norm(across) < UP_STEP:  # it looks straight down
        across = np.array([1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across)
    return np.array([across, view.up, np.cross(across, view.up)])


@numba.njit(cache=True, nogil=True)
def enclose(labels: NDArray[np.int32], depth: Depth, windows: NDArray[np.int64], areas: Array) -> None:
    """Of each label in (H, W) but 0: fill windows (N, 4) with top, left, bottom and right, and add up z^2."""
    rows, columns = labels.shape
    for n in range(len(windows)):
        windows[n, 0], windows[n, 1], windows[n, 2], windows[n, 3] = rows, columns, 0, 0
    for v in range(rows):
        for u in range(columns):
            n = labels[v, u]
            if n > 0:
                windows[n, 0], windows[n, 1] = min(windows[n, 0], v), min(windows[n, 1], u)
                windows[n, 2], windows[n, 3] = max(windows[n, 2], v + 1), max(windows[n, 3], u + 1)
                areas[n] += depth[v, u] * depth[v, u]


@numba.njit(cache=True, nogil=True)
def label(depth: Depth, foreground: Mask, growth: float, labels: NDArray[np.int32]) -> int:
    """Number in labels (H, W), which are 0, what hangs together in the foreground; gives the last number."""
    rows, columns = depth.shape
    stack = np.empty(rows * columns, dtype=np.int64)
    last = 0
    for start in range(rows * columns):
        v, u = start // columns, start % columns
        if not foreground[v, u] or labels[v, u] != 0:
            continue
        last += 1
        labels[v, u] = last
        stack[0], count = start, 1
        while count > 0:
            count -= 1
            row, column = stack[count] // columns, stack[count] % columns
            z = depth[row, column]
            step = step_at(z, growth)
            for k in range(4):
                r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
                if not (0 <= r < rows and 0 <= c < columns) or not foreground[r, c] or labels[r, c] > 0:
                    continue
                if abs(depth[r, c] - z) < step:
                    labels[r, c] = last
                    stack[count] = r * columns + c
                    count += 1
    return last


def largest_plane(points: Array, spread: float) -> tuple[Array, float]:
    """The plane (4,), n x + d = 0, with the most points (P, 3) within `spread` metres, and their share."""
    if len(points) < LEAST_POINTS:
        return np.array([0.0, 0.0, 1.0, 0.0]), 1.0
    some = points[:: max(1, len(points) // SAMPLED)]
    plane, on = segment_plane(some, spread, PLANE_ROUNDS, seed=0)
    return plane, on / len(some)


LEAST_POINTS = 20
