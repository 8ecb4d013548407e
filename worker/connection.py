"""A worker's connection: connecting with reports on the way, admission and health."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from itertools import count

from common.errors import BusError, InputError
from common.protocol import keys
from common.transport.bus import Bus
from common.transport.opening import open_worker
from common.transport.session import Security

SEEN_WITHIN_S = 5.0  # in which one session sees what another has announced

log = logging.getLogger("gepf-worker")


@dataclass(frozen=True, slots=True)
class Identity:
    """A worker's name; where it connects, with which certificate, and how long it tries."""

    name: str
    connect: tuple[str, ...]
    security: Security | None = None
    timeout: float | None = None  # seconds; None to try for ever

    @property
    def place(self) -> str:
        """Where it connects, for people."""
        return ", ".join(self.connect)


def connect_to(identity: Identity) -> Bus:
    """Open a worker's session, and report on the way what happens.

    Raises InputError if it is refused, BusError if nobody has answered when the time is up.
    """
    log.info("connecting to %s", identity.place)
    silences = count()

    def report_silence(seconds: float) -> None:
        if identity.timeout is not None and seconds >= identity.timeout:
            raise BusError(
                f"nobody answered at {identity.place} within {identity.timeout:g} s; start the coordinator "
                "or router there, or give more time with --connect-timeout"
            )
        if next(silences) == 0:
            log.info("nobody answers at %s yet; trying on, Ctrl-C ends", identity.place)

    bus = open_worker(identity.connect, identity.security, report_silence)
    bus.watch_links(report_link)
    return bus


def report_link(endpoint: str, linked: bool) -> None:
    """Log a link that comes or goes."""
    if linked:
        log.info("connected to %s", endpoint)
    else:
        log.warning("%s is gone; trying to reach it again", endpoint)


def check_admission(bus: Bus, identity: Identity, security: Security) -> None:
    """Announce the worker and look for it through a second session; InputError if it cannot be seen.

    That is how to tell whether the other side accepts its name: access control drops messages silently.
    """
    name, key = identity.name, keys.of_worker(identity.name, "admission")
    bus.announce(key)
    if not is_seen(key, identity):
        raise InputError(
            f"{identity.place} does not let {security.credentials.cert} be worker '{name}'; "
            f"have '{name}' listed there in workers.txt, and give the certificate for that name"
        )


def check_alive(identity: Identity) -> None:
    """Look for the worker's liveliness token, as the health check of a container; BusError without it."""
    if not is_seen(keys.of_worker(identity.name, "alive"), identity):
        raise BusError(f"worker '{identity.name}' is not seen at {identity.place}")


def is_seen(key: str, identity: Identity) -> bool:
    """Whether a session of its own sees a liveliness token soon."""
    seen = threading.Event()
    with open_worker(identity.connect, identity.security) as mirror:
        mirror.watch(key, lambda _, alive: seen.set() if alive else None)
        return seen.wait(SEEN_WITHIN_S)
