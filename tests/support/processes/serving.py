"""Coordinator and workers joined in one process over the real bus, and what they are asked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import SubjectFrame
from gepf.common.kernel import Kernel
from gepf.common.protocol.messages import RefineRequest
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.worker.service import Service
from gepf.worker.warm_up import tiny_frame, tiny_model
from tests.support.answers import as_bytes
from tests.support.processes.instant_worker import KERNEL, observe, refine

MODEL = tiny_model()
SETTINGS = RefineSettings(damping=0.7)
POSES = np.random.default_rng(0).normal(size=(20, 6)) * 0.01 + [0, 0, 2, 0, 0, 0]
PARTICLES = Particles(POSES, SETTINGS)


def frame(number: int) -> SubjectFrame:
    """A frame that differs from others by its depth."""
    subject = tiny_frame()
    (view,) = subject.views
    depth = np.where(view.image.depth > 0, 2000 + number, 0).astype(np.uint16)
    return replace(subject, number=number, views=(replace(view, image=replace(view.image, depth=depth)),))


def expected(number: int, poses: Array = POSES) -> list[bytes]:
    """The expected result of refining poses on a frame."""
    return as_bytes(refine(MODEL, observe(frame(number)), Particles(poses, SETTINGS)))


@contextmanager
def serving(
    endpoint: str, name: str, kernel: Kernel = KERNEL, through: Callable[[Bus], Any] = lambda bus: bus
) -> Iterator[None]:
    """A worker in a thread, which reaches the bus `through` something."""
    with open_worker([endpoint]) as bus, running(Service(through(bus), name, kernel)):
        yield


@contextmanager
def running(service: Service, seconds: float = 300.0) -> Iterator[Service]:
    """A service in a thread, which must end within the time when it is stopped."""
    thread = threading.Thread(target=service.run)
    thread.start()
    try:
        yield service
    finally:
        service.stop()
        thread.join(seconds)
        assert not thread.is_alive()


class WatchedBus:
    """A bus on which fetching fails as often as `in_vain` yields, and which records the fetched keys."""

    def __init__(self, bus: Bus, in_vain: Iterator[int], fetched: SimpleQueue[str]) -> None:
        self._bus = bus
        self._in_vain = in_vain
        self._fetched = fetched

    def fetch(self, key: str) -> bytes | None:
        """What is stored under a key, or nothing."""
        self._fetched.put(key)
        return self._bus.fetch(key) if next(self._in_vain, None) is None else None

    def __getattr__(self, name: str) -> Any:
        """All else is the bus's own."""
        return getattr(self._bus, name)


def pool(endpoint: str, **options: Any) -> ZenohRefiner:
    """A coordinator without workers of its own."""
    return ZenohRefiner(Pool(workers=0, listen=endpoint, worker_timeout=300.0, **options))


def refined_bytes(refiner: ZenohRefiner, number: int, poses: Array = POSES) -> list[bytes]:
    """Have poses refined on a frame."""
    return as_bytes(refiner.submit(frame(number), MODEL, Particles(poses, SETTINGS)).result())


REQUEST = RefineRequest("coordinator/ghost", 1, MODEL.hash, PARTICLES)
