"""Planes by RANSAC, as Open3D does it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def segment_plane(points: Array, within: float, rounds: int, seed: int) -> tuple[Array, int]:
    """The plane (4,), n x + d = 0, that the most points (P, 3) are within a distance of, and how many."""
    open3d = load_open3d()
    open3d.utility.random.seed(seed)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    plane, on = cloud.segment_plane(within, ransac_n=3, num_iterations=rounds, probability=1.0)
    return np.asarray(plane), len(on)


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
