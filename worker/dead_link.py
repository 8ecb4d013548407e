"""A link at whose end nobody is any more.

When a coordinator closes in the very moment in which a worker connects, the link may stay for as long as the
coordinator's process lives. The bus takes it for a good one, and so never connects to the next coordinator.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from common.errors import BusError
from common.protocol import keys
from common.transport.bus import Bus

ASKED_S = 1.0  # between questions whether anybody is there, while nothing comes
ANSWER_S = 0.2  # for an answer
MOST_IN_VAIN = 10  # in a row


class DeadLink:
    """Tells a dead link by this: it leads to a coordinator, and no run there answers, however often asked."""

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
