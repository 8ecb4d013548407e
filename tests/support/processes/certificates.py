"""Certificates to test with (good, of another authority, over), and sides that connect with them."""

from __future__ import annotations

import datetime as dt
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gepf.common.transport.bus import Bus
from gepf.common.transport.credentials import Credentials
from gepf.common.transport.opening import open_worker
from gepf.common.transport.session import COORDINATOR, ROUTER, Security
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.security.access import read_coordinators, read_workers
from gepf.coordinator.security.authority import find_authority
from gepf.coordinator.security.certificates import make_certificates
from gepf.coordinator.security.issuing import issue, save
from gepf.worker.service import Service
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.serving import running

WORKERS = ("w0", "w1")
ROOMS = ("room", "room-2")  # coordinators that share a router
STRANGER = "stranger"  # signed, but not listed


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder of certificates."""

    path: Path

    def of(self, name: str, ca: Path | None = None) -> Credentials:
        """The certificate for a name."""
        return Credentials(ca or self.path / "ca.pem", self.path / f"{name}.pem", self.path / f"{name}.key")

    def options(self, name: str) -> list[str]:
        """The same, for a command line."""
        own = self.of(name)
        return ["--tls-ca", str(own.ca), "--tls-cert", str(own.cert), "--tls-key", str(own.key)]

    @property
    def listening(self) -> Security:
        """The coordinator's certificate and access rules."""
        own = self.of(COORDINATOR)
        return Security(own, read_workers(own.ca), read_coordinators(own.ca))

    @property
    def routing(self) -> Security:
        """The router's certificate and access rules."""
        return Security(self.of(ROUTER), WORKERS, read_coordinators(self.path / "ca.pem"))


def make_folder(path: Path) -> Folder:
    """A good set, and in it `stranger`, and `old`, a certificate of `w0` that is over."""
    make_certificates(path, WORKERS, (), 1, None, ROOMS)
    signer, _ = find_authority(path)
    save(path, STRANGER, issue(STRANGER, (), signer, dt.timedelta(days=1)))
    save(path, "old", issue("w0", (), signer, dt.timedelta(minutes=-1)))
    return Folder(path)


def free_port() -> int:
    """A port of this host that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def secure_worker(place: str, folder: Folder, name: str, claim: str | None = None) -> Iterator[Bus]:
    """A worker in a thread, with one name's certificate, that claims a name."""
    with open_worker([place], Security(folder.of(name))) as bus, running(Service(bus, claim or name, KERNEL)):
        yield bus


def listening(place: str, folder: Folder) -> ZenohRefiner:
    """A coordinator that lets workers in."""
    return ZenohRefiner(Pool(workers=0, listen=place, security=folder.listening, worker_timeout=300.0))
