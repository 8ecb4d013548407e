"""The connection of a worker: connecting with messages, admission and health."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

from gepf.common.errors import BusError, InputError
from gepf.common.protocol import keys
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.common.transport.session import Security

SEEN_WITHIN_S = 5.0  # until a session sees the token of another

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
            log.info("no answer at %s yet; retrying, Ctrl-C ends", identity.place)

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
    if not is_seen(key, identity):
        raise InputError(
            f"{identity.place} does not admit worker '{name}'; have it listed there in workers.txt"
        )


def check_alive(identity: Identity) -> None:
    """Health check of a container: BusError if the worker is not seen, or nothing answers."""

    def give_up() -> None:
        raise BusError(f"no answer at {identity.place}")

    if not is_seen(keys.of_worker(identity.name, "alive"), identity, give_up):
        raise BusError(f"worker '{identity.name}' is not seen at {identity.place}")


def is_seen(key: str, identity: Identity, on_silence: Callable[[], None] = lambda: None) -> bool:
    """Whether a separate session sees a liveliness token soon; `on_silence` is that of `open_worker`."""
    seen = threading.Event()
    with open_worker(identity.connect, identity.security, on_silence) as mirror:
        mirror.watch(key, lambda _, alive: seen.set() if alive else None)
        return seen.wait(SEEN_WITHIN_S)
