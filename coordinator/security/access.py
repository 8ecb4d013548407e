"""Access control of runs and routers, and their certificates.

The admitted workers are listed in a text file beside the certificate of the authority, one name per line.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gepf.common.errors import InputError
from gepf.common.protocol.keys import check_name
from gepf.common.transport.credentials import check_holder, read_credentials
from gepf.common.transport.endpoints import CONNECT, LISTEN, check_endpoint
from gepf.common.transport.session import COORDINATOR, ROUTER, Security

ROSTER = "workers.txt"


def read_roster(ca: Path) -> tuple[str, ...]:
    """The admitted workers of an authority; InputError if there is no list."""
    path = ca.parent / ROSTER
    if not path.exists():
        raise InputError(f"{path} is missing; write the names of all allowed workers there, one per line")
    return list_workers(path)


def list_workers(path: Path) -> tuple[str, ...]:
    """The names in a file, empty if it is missing; InputError for an invalid name."""
    lines = path.read_text(errors="replace").splitlines() if path.exists() else []
    names = (line.strip() for line in lines)
    return tuple(check_worker(name) for name in names if name and not name.startswith("#"))


def choose_names(workers: str) -> tuple[str, ...]:
    """Names of workers between commas, or `worker-0` and so on for a number."""
    if workers.isascii() and workers.isdigit():
        return tuple(f"worker-{k}" for k in range(int(workers)))
    return tuple(check_worker(name.strip()) for name in workers.split(","))


def check_worker(name: str) -> str:
    """A valid name of a worker; InputError otherwise."""
    if name in (COORDINATOR, ROUTER):
        raise InputError(f"a worker cannot have the name '{name}'; give another name")
    return check_name("worker name", name)


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """The certificate of the authority, our certificate, and its key; all three or none."""

    ca: str | Path | None = None
    cert: str | Path | None = None
    key: str | Path | None = None


def choose_security(
    listen: str | None,
    connect: str | None,
    files: TlsFiles,
    *,
    holder: str = COORDINATOR,
    insecure: bool = False,
) -> Security | None:
    """Certificates and access rules for these endpoints; None without certificates.

    InputError for a certificate that does not belong to `holder`, and for an unencrypted link to other hosts
    unless `insecure` is set.
    """
    credentials = read_credentials(files.ca, files.cert, files.key)
    for option, endpoint in ((LISTEN, listen), (CONNECT, connect)):
        if endpoint is not None:
            check_endpoint(option, endpoint, credentials, insecure=insecure)
    if credentials is None:
        return None
    check_holder(credentials, holder)
    return Security(credentials, None if listen is None else read_roster(credentials.ca))
