"""What is said when the router that a run is connected to goes, and when it is back."""

from __future__ import annotations

from collections.abc import Callable

from common.transport.endpoints import LOCAL, protocol_of


class RouterLink:
    """Reports of links; those to workers of our own, on this host, are none of a router."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._gone: set[str] = set()

    def change(self, endpoint: str, linked: bool) -> None:
        """A link comes or goes; called on a thread of the bus."""
        if protocol_of(endpoint) == LOCAL:
            return
        if not linked:
            self._gone.add(endpoint)
            self._report(f"{endpoint} is gone; trying to reach it again")
        elif endpoint in self._gone:
            self._gone.remove(endpoint)
            self._report(f"{endpoint} is back")
