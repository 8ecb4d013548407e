"""Access control of runs and routers, and their certificates.

The admitted workers and coordinators are listed in two text files beside the certificate of the authority,
one name per line.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gepf.common.errors import InputError
from gepf.common.protocol.keys import check_name
from gepf.common.transport.credentials import check_holder, holder_of, read_credentials
from gepf.common.transport.endpoints import CONNECT, LISTEN, check_endpoint
from gepf.common.transport.session import COORDINATOR, ROUTER, Security

WORKERS_FILE = "workers.txt"
COORDINATORS_FILE = "coordinators.txt"


def read_workers(ca: Path) -> tuple[str, ...]:
    """The admitted workers of an authority; InputError if there is no list."""
    path = ca.parent / WORKERS_FILE
    if not path.exists():
        raise InputError(f"{path} is missing; write the names of all allowed workers there, one per line")
    return tuple(map(check_worker, list_names(path)))


def read_coordinators(ca: Path) -> tuple[str, ...]:
    """The admitted coordinators of an authority; only `coordinator` if there is no list."""
    listed = [check_name("coordinator", name) for name in list_names(ca.parent / COORDINATORS_FILE)]
    return tuple(dict.fromkeys((COORDINATOR, *listed)))


def list_names(path: Path) -> tuple[str, ...]:
    """The names in a file, empty if it is missing."""
    lines = path.read_text(errors="replace").splitlines() if path.exists() else []
    names = (line.strip() for line in lines)
    return tuple(name for name in names if name and not name.startswith("#"))


def choose_names(workers: str) -> tuple[str, ...]:
    """Names of workers, from a comma-separated list; for a number, `worker-0` and so on."""
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
    holder: str | None = None,
    insecure: bool = False,
) -> Security | None:
    """Certificates and access rules for these endpoints; None without certificates.

    InputError for a certificate that does not belong to `holder` or, without `holder`, to a coordinator; and
    for an unencrypted link to other hosts, unless `insecure` is set.
    """
    credentials = read_credentials(files.ca, files.cert, files.key)
    for option, endpoint in ((LISTEN, listen), (CONNECT, connect)):
        if endpoint is not None:
            check_endpoint(option, endpoint, credentials, insecure=insecure)
    if credentials is None:
        return None
    coordinators = read_coordinators(credentials.ca)
    if holder is not None:
        check_holder(credentials, holder)
    elif (name := holder_of(credentials)) not in coordinators:
        admitted, roster = " or ".join(map(repr, coordinators)), credentials.ca.parent / COORDINATORS_FILE
        raise InputError(
            f"certificate {credentials.cert} is for '{name}', not for {admitted}; give the certificate of a "
            f"coordinator, or list '{name}' in {roster}"
        )
    if listen is None:
        return Security(credentials)
    return Security(credentials, read_workers(credentials.ca), coordinators)
