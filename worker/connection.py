"""A worker's connection: reports whom it tries, that nobody answers, who is gone and who is back."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass

from common.errors import BusError, InputError
from common.transport.bus import Bus
from common.transport.opening import open_worker
from common.transport.session import Security

REPEATED_S = 10.0  # between lines that say that nobody answers
ATTEMPT_S = 0.5

log = logging.getLogger("gepf-worker")


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
