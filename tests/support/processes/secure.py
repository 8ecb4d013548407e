"""Who connects with a certificate: a worker in a thread, and a coordinator that listens."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from common.transport.bus import Bus
from common.transport.opening import open_worker
from common.transport.session import Security
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.processes.certificates import Folder
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.serving import running
from worker.service import Service


@contextmanager
def secure_worker(place: str, folder: Folder, name: str, claim: str | None = None) -> Iterator[Bus]:
    """A worker in a thread, with somebody's certificate, that claims to be somebody."""
    with open_worker([place], Security(folder.of(name))) as bus, running(Service(bus, claim or name, KERNEL)):
        yield bus


def listening(place: str, folder: Folder) -> ZenohRefiner:
    """A coordinator that lets workers in."""
    return ZenohRefiner(Pool(workers=0, listen=place, security=folder.listening, worker_timeout=60.0))
