"""`gepf-worker`: one worker, from the command line."""

from __future__ import annotations

import gc
import logging
import math
import os
import re
import signal
import socket
import sys
import threading
import uuid
from collections.abc import Callable
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from typer import Option

from gepf.common.bounds import MAX_PARTICLES
from gepf.common.cores import usable_cores
from gepf.common.errors import GepfError, InputError
from gepf.common.kernel import ENTRY_POINTS, Kernel
from gepf.common.offer import CPU, Offer
from gepf.common.protocol.keys import check_name
from gepf.common.transport.credentials import Credentials, check_holder, holder_of, read_credentials
from gepf.common.transport.endpoints import CONNECT, check_endpoint
from gepf.common.transport.session import Security
from gepf.worker.connection import Identity, check_admission, check_alive, connect_to
from gepf.worker.service import Service

log = logging.getLogger("gepf-worker")


def main() -> None:
    """Entry point."""
    app = typer.Typer(add_completion=False)
    app.command()(work)

    def job() -> None:
        try:
            app(standalone_mode=False)
        except typer.TyperException as error:
            said = error.format_message().rstrip(".")
            raise InputError(f"{said}; gepf-worker --help lists all options") from error

    exit_with(job)


def work(  # noqa: PLR0913 one parameter an option
    connect: Annotated[list[str], Option(metavar="ENDPOINT", help="A coordinator or router: tls/HOST:PORT.")],
    *,
    lanes: Annotated[int | None, Option(metavar="N", help="Particles at once (default: one a core).")] = None,
    kind: Annotated[str, Option(metavar="NAME", help="Kernel: cpu, or that of another package.")] = CPU,
    name: Annotated[str | None, Option(metavar="NAME", help="Name (default: the certificate's).")] = None,
    connect_timeout: Annotated[
        float, Option(metavar="SECONDS", help="Longest wait for an answer (default: for ever).", min=0.0)
    ] = math.inf,
    tls_ca: Annotated[Path | None, Option(metavar="FILE", help="Certificate of the authority.")] = None,
    tls_cert: Annotated[Path | None, Option(metavar="FILE", help="This worker's certificate.")] = None,
    tls_key: Annotated[Path | None, Option(metavar="FILE", help="Key of the certificate.")] = None,
    insecure: Annotated[
        bool, Option("--insecure", help="Connect to other hosts unencrypted: anyone on the way can read.")
    ] = False,
    check: Annotated[bool, Option("--check", help="Exit with 0 if this worker is connected.")] = False,
    quiet: Annotated[bool, Option("--quiet", "-q", help="Log warnings and errors only.")] = False,
    tied: Annotated[bool, Option("--tied", hidden=True, help="End when standard input ends.")] = False,
) -> None:
    """Refine particles for all connected coordinators until stopped. A host needs one worker."""
    credentials = read_credentials(tls_ca, tls_cert, tls_key)
    for endpoint in connect:
        check_endpoint(CONNECT, endpoint, credentials, insecure=insecure)
    identity = choose_identity(connect, name, credentials, connect_timeout)
    if lanes is not None and not 1 <= lanes <= MAX_PARTICLES:
        raise InputError(f"--lanes {lanes} is not valid; give 1 to {MAX_PARTICLES}, or none for all cores")
    if check:
        logging.getLogger().setLevel(logging.WARNING)
        check_alive(identity)
    else:
        serve(identity, partial(find_kernel(kind), lanes), quiet=quiet, tied=tied)


def choose_identity(
    connect: list[str], name: str | None, credentials: Credentials | None, timeout: float
) -> Identity:
    """The checked identity of a worker from its options; its name is also that of its certificate or host."""
    if name is None and credentials is not None:
        name = holder_of(credentials)
    elif name is None:
        host = re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())[:32].strip("-") or "worker"
        name = f"{host}-{uuid.uuid4().hex[:8]}"
    check_name("worker name", name)
    if credentials is not None:
        check_holder(credentials, name)
    security = None if credentials is None else Security(credentials)
    return Identity(name, tuple(connect), security, timeout)


def exit_with(job: Callable[[], None]) -> NoReturn:
    """Do a job and exit: 0 when it ends or is stopped, 2 for wrong input, 1 for other errors."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(name)s: %(message)s")
    try:
        job()
    except KeyboardInterrupt:
        raise SystemExit(0) from None
    except GepfError as error:
        log.error("%s", error)  # noqa: TRY400 - one line for the user
        raise SystemExit(2 if isinstance(error, InputError) else 1) from error
    raise SystemExit(0)


def serve(identity: Identity, load: Callable[[], Kernel], *, quiet: bool = False, tied: bool = False) -> None:
    """Prepare, then serve until SIGTERM or SIGINT, or, if tied, until standard input ends."""
    if quiet:
        logging.getLogger().setLevel(logging.WARNING)
    if tied:
        threading.Thread(target=end_with_parent, daemon=True).start()
    log.info("loading, before connecting to %s; the first time this takes a minute", identity.place)
    kernel = load()
    gc.freeze()  # garbage collection of the loaded modules would take 0.1 s each time
    while serve_session(identity, kernel):
        log.warning("%s answers, but no coordinator is there any more; reconnecting", identity.place)


def serve_session(identity: Identity, kernel: Kernel) -> bool:
    """Connect and serve; True if the link is dead and a new connection is needed."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)  # while connecting, Python handles no signal
    with connect_to(identity) as bus:
        if identity.security is not None:
            check_admission(bus, identity)
        service = Service(bus, identity.name, kernel)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, partial(end, service))
        offer = kernel.offer
        lanes = "1 lane" if offer.lanes == 1 else f"{offer.lanes} lanes"
        kind = f"{offer.kind}, {offer.processor}"
        log.info("%s serves %s with %s (%s)", identity.name, identity.place, lanes, kind)
        service.run()
    return service.abandoned


def find_kernel(kind: str) -> Callable[[int | None], Kernel]:
    """The function that loads the kernel of a kind; InputError if no installed package has it."""
    if kind == CPU:
        return load_kernel
    installed = entry_points(group=ENTRY_POINTS)
    if kind not in installed.names:
        kinds = ", ".join(sorted({CPU, *installed.names}))
        raise InputError(f"no kernel of kind '{kind}' is installed; install its package, or give {kinds}")
    check_name("kind of kernel", kind)

    def load(lanes: int | None) -> Kernel:
        kernel: Kernel = installed[kind].load()(lanes)
        if kernel.offer.kind != kind:
            raise InputError(f"{installed[kind].value} loads a kernel of kind '{kernel.offer.kind}' instead")
        check_name("processor", kernel.offer.processor)
        return kernel

    return load


def load_kernel(lanes: int | None) -> Kernel:
    """The compiled kernel with this number of lanes; None for one per core."""
    from gepf.worker.kernel.observation import observe_for
    from gepf.worker.lanes import Lanes
    from gepf.worker.processor import processor_name
    from gepf.worker.warm_up import warm_up

    lanes = lanes or usable_cores()
    kernel = Kernel(observe_for, Lanes(lanes).refine, Offer(processor=processor_name(), lanes=lanes))
    warm_up(kernel)
    return kernel


def end(service: Service, *_: object) -> NoReturn:
    """Handle the first signal: exit. The coordinator sends unanswered requests to other workers.

    If a library suppresses the exception, the service ends after the present request.
    """
    for other in (signal.SIGTERM, signal.SIGINT):
        signal.signal(other, signal.SIG_IGN)
    service.stop()
    raise SystemExit(0)


def end_with_parent() -> None:
    """Wait for the end of standard input, which the parent keeps open as long as it lives."""
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
