"""A worker's connection: connecting with reports on the way, admission, health, and dead links."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from common.errors import BusError, InputError
from common.protocol import keys
from common.transport.bus import Bus
from common.transport.opening import open_worker
from common.transport.session import Security

REPEATED_S = 10.0  # between lines that say that nobody answers
ATTEMPT_S = 0.5

log = logging.getLogger("gepf-worker")


SEEN_WITHIN_S = 5.0  # in which one session sees what another has announced
ASKED_S = 1.0  # between questions whether anybody is there, while nothing comes
ANSWER_S = 0.2  # for an answer
MOST_IN_VAIN = 10  # in a row


@dataclass(frozen=True, slots=True)
class Destination:
    """Where to connect, with which certificate, and how long to try."""

    connect: tuple[str, ...]
    security: Security | None = None
    timeout: float | None = None  # seconds; None to try for ever

    @property
    def name(self) -> str:
        """For people."""
        return ", ".join(self.connect)


def connect_to(destination: Destination) -> Bus:
    """Open a session at the destination, and report on the way what happens.

    Raises InputError if it refuses us, BusError if nobody has answered when the time is up.
    """
    log.info("connecting to %s", destination.name)
    silence = Silence(destination)
    bus = open_worker(destination.connect, destination.security, silence.goes_on)
    try:
        if len(destination.connect) > 1:
            wait_for_link(bus, silence)
        bus.watch_links(report_link)
    except BaseException:
        bus.close()
        raise
    return bus


def wait_for_link(bus: Bus, silence: Silence) -> None:
    """Return when one of several endpoints has answered."""
    began = time.monotonic()
    while not bus.is_linked(within=ATTEMPT_S):
        silence.goes_on(time.monotonic() - began)


def report_link(endpoint: str, linked: bool) -> None:
    """Log a link that comes or goes."""
    if linked:
        log.info("connected to %s", endpoint)
    else:
        log.warning("%s is gone; trying to reach it again", endpoint)


class Silence:
    """Reports now and then that nobody answers, and gives up when the time is up."""

    def __init__(self, destination: Destination) -> None:
        self._destination = destination
        self._next_report = 0.0

    def goes_on(self, seconds: float) -> None:
        """Nobody has answered for so long. BusError when that is too long."""
        timeout, name = self._destination.timeout, self._destination.name
        if timeout is not None and seconds >= timeout:
            raise BusError(
                f"nobody answered at {name} within {timeout:g} s; start the coordinator or router there, "
                "or give more time with --connect-timeout"
            )
        if seconds >= self._next_report:
            self._next_report = seconds + REPEATED_S
            log.info("nobody answers at %s yet; trying for %.0f s, Ctrl-C ends", name, seconds)


def checked_timeout(seconds: float | None) -> float | None:
    """Seconds to try; None for ever."""
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise InputError(f"--connect-timeout {seconds:g} is no time to wait; give seconds above 0")
    return seconds


def check_admission(
    bus: Bus, name: str, connect: Sequence[str], security: Security, patience_s: float = SEEN_WITHIN_S
) -> None:
    """Announce the worker and look for it through a second session; InputError if it cannot be seen.

    That is how to tell whether the other side accepts its name: access control drops messages silently.
    """
    key = keys.worker_admission(name)
    bus.announce(key)
    if not is_seen(key, connect, security, patience_s):
        raise InputError(
            f"{', '.join(connect)} does not let {security.credentials.cert} be worker '{name}'; "
            f"have '{name}' listed there in workers.txt, and give the certificate for that name"
        )


def check_alive(
    name: str, connect: Sequence[str], security: Security | None, patience_s: float = SEEN_WITHIN_S
) -> None:
    """Look for the worker's liveliness token, as the health check of a container; BusError without it."""
    if not is_seen(keys.worker_alive(name), connect, security, patience_s):
        raise BusError(f"worker '{name}' is not seen at {', '.join(connect)}")


def is_seen(key: str, connect: Sequence[str], security: Security | None, patience_s: float) -> bool:
    """Whether a session of its own sees a liveliness token within so many seconds."""
    seen = threading.Event()
    with open_worker(connect, security) as mirror:
        mirror.watch(key, lambda _, alive: seen.set() if alive else None)
        return seen.wait(patience_s)


class DeadLink:
    """Tells a link at whose end nothing is any more: it leads to a coordinator, and no run there answers.

    When a coordinator closes in the very moment in which a worker connects, the link may stay for as long as
    the coordinator's process lives. The bus takes it for a good one, and never connects to the next one.
    """

    def __init__(self, bus: Bus, clock: Callable[[], float] = time.monotonic) -> None:
        self._bus = bus
        self._clock = clock
        self._due = clock() + ASKED_S
        self._in_vain = 0

    def hear(self) -> None:
        """Something has come from the other end."""
        self._due = self._clock() + ASKED_S
        self._in_vain = 0

    def is_found(self) -> bool:
        """Whether the link is dead; to be called often. It asks now and then, which takes a moment."""
        if self._clock() < self._due:
            return False
        self._in_vain = 0 if self._is_good() else self._in_vain + 1
        self._due = self._clock() + ASKED_S
        return self._in_vain > MOST_IN_VAIN

    def _is_good(self) -> bool:
        with suppress(BusError):
            return (
                not self._bus.meets_coordinator()
                or self._bus.fetch(keys.ANY_RUN_PRESENT, ANSWER_S) is not None
            )
        return False
