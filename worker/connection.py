"""The connection of a worker: opening it, with log messages, and checks of admission and health."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass
from itertools import count

from gepf.common.errors import BusError, InputError
from gepf.common.protocol import keys
from gepf.common.transport.admission import is_seen
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.common.transport.session import Security

log = logging.getLogger("gepf-worker")


@dataclass(frozen=True, slots=True)
class Identity:
    """Name of a worker, its endpoints and certificate, and the timeout for connecting."""

    name: str
    connect: tuple[str, ...]
    security: Security | None = None
    timeout: float = math.inf  # seconds

    @property
    def place(self) -> str:
        """The endpoints, as text."""
        return ", ".join(self.connect)


def connect_to(identity: Identity) -> Bus:
    """Open the session of a worker, with messages on the progress.

    Raises InputError if it is refused, BusError without an answer within the timeout.
    """
    log.info("connecting to %s", identity.place)
    began, silences = time.monotonic(), count()

    def report_silence() -> None:
        if time.monotonic() - began >= identity.timeout:
            raise BusError(
                f"no answer at {identity.place} within {identity.timeout:g} s; start the coordinator there"
            )
        if next(silences) == 0:
            log.info("no answer at %s yet; retrying (Ctrl-C to stop)", identity.place)

    bus = open_worker(identity.connect, identity.security, report_silence)
    bus.watch_links(report_link)
    return bus


def report_link(endpoint: str, linked: bool) -> None:
    """Log a link that is opened or closed."""
    if linked:
        log.info("connected to %s", endpoint)
    else:
        log.warning("%s is gone; trying to reach it again", endpoint)


def check_admission(bus: Bus, identity: Identity) -> None:
    """Announce the worker and look for it through a second session; InputError if it cannot be seen.

    This shows whether the other side accepts its name: access control drops messages silently.
    """
    name, key = identity.name, keys.of_worker(identity.name, "admission")
    bus.announce(key)
    if not is_seen(key, identity.connect, identity.security):
        raise InputError(
            f"{identity.place} does not admit worker '{name}'; have it listed there in workers.txt"
        )


def check_alive(identity: Identity) -> None:
    """Health check of a container: BusError if the worker is not seen, or nothing answers."""

    def give_up() -> None:
        raise BusError(f"no answer at {identity.place}")

    offer = keys.of_worker(identity.name, "offer/**")
    if not is_seen(offer, identity.connect, identity.security, give_up):
        raise BusError(f"worker '{identity.name}' is not seen at {identity.place}")
