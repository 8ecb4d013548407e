"""The same scatter and gather by other means: a process pool with shared memory, and Ray.

Each frame is put where all workers can read it; batches of poses go out, their results come back in order. A
result is the pose itself, so that all the time is overhead.
"""

from __future__ import annotations

import logging
import multiprocessing
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coordinator.batches import split

Array = NDArray[np.float64]
Depth = NDArray[np.uint16]
Frame = Callable[[Depth, Array], Array]
"""Scatters a frame and poses (N, D), and gathers the results (N, D)."""

_attached: dict[str, SharedMemory] = {}


@contextmanager
def process_pool(workers: int, shape: tuple[int, int]) -> Iterator[Frame]:
    """ProcessPoolExecutor; the frame lies in shared memory that is allocated once."""
    size = int(np.prod(shape)) * np.dtype(np.uint16).itemsize
    memory = SharedMemory(create=True, size=size)
    place: Depth = np.ndarray(shape, np.uint16, memory.buf)
    context = multiprocessing.get_context("forkserver")
    try:
        with ProcessPoolExecutor(workers, context) as pool:

            def frame(depth: Depth, poses: Array) -> Array:
                place[:] = depth
                futures = [
                    pool.submit(read_and_return, memory.name, shape, poses[start:stop])
                    for start, stop in split(len(poses), workers)
                ]
                return np.concatenate([future.result() for future in futures])

            yield frame
    finally:
        memory.close()
        memory.unlink()


def read_and_return(name: str, shape: tuple[int, int], poses: Array) -> Array:
    """What a worker of the pool does: look at the frame, give the poses back."""
    if name not in _attached:
        _attached[name] = SharedMemory(name)
    look_at(np.ndarray(shape, np.uint16, _attached[name].buf))
    return poses


def look_at(depth: Depth) -> int:
    """Touch every page of a frame, as reading it would."""
    return int(depth.ravel()[::2048].sum())


@contextmanager
def ray_tasks(workers: int) -> Iterator[Frame]:
    """Ray: the frame in its object store, a task for each batch. ImportError where Ray is not installed."""
    import ray

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
    try:
        task: Any = ray.remote(look_and_return)

        def frame(depth: Depth, poses: Array) -> Array:
            reference = ray.put(depth)
            tasks = [task.remote(reference, poses[a:b]) for a, b in split(len(poses), workers)]
            return np.concatenate(ray.get(tasks))

        yield frame
    finally:
        ray.shutdown()


def look_and_return(depth: Depth, poses: Array) -> Array:
    """What a worker of Ray's does."""
    look_at(depth)
    return poses
