"""Geometry of depth images: planes by RANSAC as Open3D does it, and parts that hang together in depth."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.noise import step_at

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int32]
Lens = tuple[float, float, float, float]  # fx, fy, cx, cy
Window = tuple[int, int, int, int]  # left, top, right, bottom in pixels, half-open


def segment_plane(points: Array, within: float, rounds: int, seed: int) -> tuple[Array, Array]:
    """The plane (4,), n x + d = 0, that the most points (P, 3) are within a distance of; indices of these."""
    open3d = load_open3d()
    open3d.utility.random.seed(seed)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    plane, on = cloud.segment_plane(within, ransac_n=3, num_iterations=rounds, probability=1.0)
    return np.asarray(plane), np.asarray(on)


@lru_cache(maxsize=1)
def load_open3d() -> ModuleType:
    """Open3D, which takes a second."""
    with held_interrupts():
        import open3d

        return open3d


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Put an interrupt off to the end of the context: Open3D does not load again after one.

    A second one ends the process.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[int] = []

    def hold(number: int, _: object) -> None:
        came.append(number)
        signal.signal(number, signal.SIG_DFL)

    signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        signal.raise_signal(signal.SIGINT)


def label_parts(depth: Depth, inside: Mask, growth: float) -> Labels:
    """Label what hangs together in depth (H, W) among the pixels inside: 1, 2, ... from the top; 0 outside.

    Neighbouring pixels hang together where they are no farther apart than the noise of `growth` allows on
    one surface.
    """
    labels = np.zeros(depth.shape, dtype=np.int32)
    label_pixels(depth, inside, growth, labels)
    return labels


@numba.njit(cache=True, nogil=True)
def label_pixels(depth: Depth, inside: Mask, growth: float, labels: Labels) -> None:
    """Fill labels (H, W), 0 before, as `label_parts` says."""
    rows, columns = depth.shape
    stack = np.empty(rows * columns, dtype=np.int64)
    last = 0
    for start in range(rows * columns):
        if not inside[start // columns, start % columns] or labels[start // columns, start % columns] != 0:
            continue
        last += 1
        labels[start // columns, start % columns] = last
        stack[0], count = start, 1
        while count > 0:
            count -= 1
            row, column = stack[count] // columns, stack[count] % columns
            z = depth[row, column]
            step = step_at(z, growth)
            for k in range(4):
                r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
                if not (0 <= r < rows and 0 <= c < columns) or not inside[r, c] or labels[r, c] > 0:
                    continue
                if abs(depth[r, c] - z) < step:
                    labels[r, c] = last
                    stack[count] = r * columns + c
                    count += 1
