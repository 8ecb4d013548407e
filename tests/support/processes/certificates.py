"""Certificates to test with: a good set, one of another authority, and one that is over."""

from __future__ import annotations

import datetime as dt
import socket
from dataclasses import dataclass
from pathlib import Path

from common.transport.credentials import Credentials
from common.transport.session import COORDINATOR, ROUTER, Security
from coordinator.security.access import read_roster
from coordinator.security.certificates import Holder, find_authority, issue, make_certificates, save

WORKERS = ("w0", "w1")
STRANGER = "stranger"  # signed, but not listed


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder of certificates."""

    path: Path

    def of(self, name: str, ca: Path | None = None) -> Credentials:
        """Somebody's certificate."""
        return Credentials(ca or self.path / "ca.pem", self.path / f"{name}.pem", self.path / f"{name}.key")

    def options(self, name: str) -> list[str]:
        """The same, for a command line."""
        own = self.of(name)
        return ["--tls-ca", str(own.ca), "--tls-cert", str(own.cert), "--tls-key", str(own.key)]

    @property
    def listening(self) -> Security:
        """What a coordinator listens with."""
        own = self.of(COORDINATOR)
        return Security(own, read_roster(own.ca))

    @property
    def routing(self) -> Security:
        """What a router listens with."""
        return Security(self.of(ROUTER), WORKERS)


def make_folder(path: Path) -> Folder:
    """A good set, and in it `stranger`, and `old`, a certificate of `w0` that is over."""
    make_certificates(path, WORKERS, (), 1, None)
    signer = find_authority(path, dt.timedelta(days=1))
    save(path, STRANGER, *issue(Holder(STRANGER), signer, dt.timedelta(days=1)))
    save(path, "old", *issue(Holder("w0"), signer, dt.timedelta(minutes=-1)))
    return Folder(path)


def free_port() -> int:
    """A port of this host that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
