"""The same scatter and gather by a process pool with shared memory, and by Ray.

Batches of poses are sent, the next frame is stored where all workers can read it, and results are returned in
order. A result is the pose itself, after the time that a kernel would take. All other time is overhead.
"""

from __future__ import annotations

import logging
import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from itertools import cycle
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.coordinator.pool.scheduler import split

Depth = NDArray[np.uint16]
Frame = Callable[[Depth, Array], Array]
"""Scatters poses (N, D) about the frame it was given last, takes the next one, and gathers results (N, D)."""

_attached: dict[str, SharedMemory] = {}


@contextmanager
def process_pool(workers: int, shape: tuple[int, int], seconds: float) -> Iterator[Frame]:
    """ProcessPoolExecutor; this frame and the next are in shared memory that is allocated once."""
    size = int(np.prod(shape)) * np.dtype(np.uint16).itemsize
    with ExitStack() as stack:
        memories = [stack.enter_context(shared(size)) for _ in range(2)]
        places: list[Depth] = [np.ndarray(shape, np.uint16, memory.buf) for memory in memories]
        context = multiprocessing.get_context("forkserver")
        pool = stack.enter_context(ProcessPoolExecutor(workers, context))
        turns = cycle(range(2))

        def frame(depth: Depth, poses: Array) -> Array:
            now = next(turns)
            futures = [
                pool.submit(read_and_return, memories[now].name, shape, poses[start:stop], seconds)
                for start, stop in split(len(poses), [1] * workers)
            ]
            places[1 - now][:] = depth
            return np.concatenate([future.result() for future in futures])

        yield frame


@contextmanager
def shared(size: int) -> Iterator[SharedMemory]:
    """Memory that other processes can map."""
    memory = SharedMemory(create=True, size=size)
    try:
        yield memory
    finally:
        memory.close()
        memory.unlink()


def read_and_return(name: str, shape: tuple[int, int], poses: Array, seconds: float) -> Array:
    """The task of a worker of the pool: read the frame, wait, return the poses."""
    if name not in _attached:
        _attached[name] = SharedMemory(name)
    look_at(np.ndarray(shape, np.uint16, _attached[name].buf))
    time.sleep(seconds * len(poses))
    return poses


def look_at(depth: Depth) -> int:
    """Read every page of a frame."""
    return int(depth.ravel()[::2048].sum())


@contextmanager
def ray_tasks(workers: int, shape: tuple[int, int], seconds: float) -> Iterator[Frame]:
    """Ray: frames in its object store, a task for each batch. ImportError if Ray is not installed."""
    import ray

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
    try:
        task: Any = ray.remote(look_and_return)
        coming: list[Any] = [ray.put(np.zeros(shape, np.uint16))]

        def frame(depth: Depth, poses: Array) -> Array:
            now = coming.pop()
            tasks = [task.remote(now, poses[a:b], seconds) for a, b in split(len(poses), [1] * workers)]
            coming.append(ray.put(depth))
            return np.concatenate(ray.get(tasks))

        yield frame
    finally:
        ray.shutdown()


def look_and_return(depth: Depth, poses: Array, seconds: float) -> Array:
    """The task of a Ray worker."""
    look_at(depth)
    time.sleep(seconds * len(poses))
    return poses
