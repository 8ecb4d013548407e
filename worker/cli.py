"""`gepf-worker`: one worker, from the command line."""

from __future__ import annotations

import logging
import os
import re
import signal
import socket
import sys
import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from common.errors import GepfError, InputError
from common.protocol.keys import check_name
from common.transport.bus import open_worker
from common.transport.credentials import Credentials, check_holder, holder_of, read_credentials
from common.transport.endpoints import check_endpoint
from common.transport.session import Security
from worker.admission import check_admission
from worker.health import check_alive
from worker.service import Kernel, Service

log = logging.getLogger("gepf-worker")

Connect = Annotated[
    list[str], typer.Option(metavar="ENDPOINT", help="Where a coordinator or router listens: tls/HOST:PORT.")
]
Name = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="What the worker is called; unique (default: as its certificate)."),
]
TlsCa = Annotated[
    Path | None,
    typer.Option("--tls-ca", metavar="FILE", help="Certificate of the authority."),
]
TlsCert = Annotated[
    Path | None, typer.Option("--tls-cert", metavar="FILE", help="This worker's certificate.")
]
TlsKey = Annotated[Path | None, typer.Option("--tls-key", metavar="FILE", help="The certificate's key.")]
Check = Annotated[
    bool,
    typer.Option("--check", help="Only check whether this worker is connected; exit code 0 if so, 1 if not."),
]
Tied = Annotated[bool, typer.Option("--tied", hidden=True, help="End when standard input ends.")]


def main() -> None:
    """Entry point."""
    typer.run(work)


@dataclass(frozen=True, slots=True)
class Identity:
    """Where a worker connects, under which name, and with which certificate."""

    connect: tuple[str, ...]
    name: str
    security: Security | None = None


def work(
    connect: Connect,
    *,
    name: Name = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    check: Check = False,
    tied: Tied = False,
) -> None:
    """Refine particles for any coordinator that is connected, until stopped."""

    def job() -> None:
        identity = choose_identity(connect, name, read_credentials(tls_ca, tls_cert, tls_key))
        if check:
            check_alive(identity.name, identity.connect, identity.security)
        else:
            serve(identity, load_kernel, tied=tied)

    exit_with(job)


def choose_identity(connect: list[str], name: str | None, credentials: Credentials | None) -> Identity:
    """A worker's identity from its options, checked; a certificate also gives its name."""
    for endpoint in connect:
        check_endpoint("--connect", endpoint, credentials)
    if credentials is None:
        return Identity(tuple(connect), check_name("worker name", name or invent_name()))
    name = check_name("worker name", name or holder_of(credentials))
    check_holder(credentials, name)
    return Identity(tuple(connect), name, Security(credentials))


def exit_with(job: Callable[[], None]) -> NoReturn:
    """Do a job and exit: 0 when it ends or is stopped, 2 for faults of the user, 1 for others."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(name)s: %(message)s")
    try:
        job()
    except KeyboardInterrupt:
        raise SystemExit(0) from None
    except GepfError as error:
        log.error("%s", error)  # noqa: TRY400 - one line for the user
        raise SystemExit(2 if isinstance(error, InputError) else 1) from error
    raise SystemExit(0)


def serve(identity: Identity, load: Callable[[], Kernel[Any]], *, tied: bool) -> None:
    """Get ready, then serve until SIGTERM or SIGINT, or, if tied, until standard input ends."""
    if tied:
        threading.Thread(target=end_with_parent, daemon=True).start()
    kernel = load()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)  # while connecting, Python handles no signal
    with open_worker(identity.connect, identity.security) as bus:
        if identity.security is not None:
            check_admission(bus, identity.name, identity.connect, identity.security)
        service = Service(bus, identity.name, kernel)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, end)
        log.info("%s serves %s", identity.name, ", ".join(identity.connect))
        service.run()


def load_kernel() -> Kernel[Any]:
    """The kernel, compiled and loaded."""
    from worker.kernel.icp import refine
    from worker.kernel.observation import observe
    from worker.warm_up import warm_up

    kernel = Kernel(observe, refine)
    warm_up(kernel)
    return kernel


def end(*_: object) -> NoReturn:
    """Handle a signal: exit, once; the coordinator sends requests without an answer elsewhere."""
    for other in (signal.SIGTERM, signal.SIGINT):
        signal.signal(other, signal.SIG_IGN)
    raise SystemExit(0)


def end_with_parent() -> None:
    """Wait for the end of standard input, which a parent holds open as long as it lives."""
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def invent_name() -> str:
    """A unique name: the host's, and a few random digits."""
    host = re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:32].strip("-") or "worker"
    return f"{host}-{uuid.uuid4().hex[:8]}"


if __name__ == "__main__":
    main()
