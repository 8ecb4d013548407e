"""How long nobody has been there: when to say so, and when to give up."""

from __future__ import annotations

from common.errors import NoWorkers

NOTICE = 5.0  # seconds without a worker until we say so


class Absence:
    """Keeps time while there is no worker; has no clock of its own."""

    def __init__(self, timeout: float | None, line: str, invitation: str) -> None:
        self._timeout = timeout  # seconds until we give up; None for never
        self._line = line
        self._invitation = invitation
        self._since: float | None = None
        self._told = False

    def end(self) -> None:
        """Somebody came."""
        self._since, self._told = None, False

    def look(self, now: float) -> str | None:
        """A line to tell, once, if nobody has come for a while; NoWorkers if the wait is over."""
        self._since = now if self._since is None else self._since
        alone = now - self._since
        if self._timeout is not None and alone > self._timeout:
            self.end()
            raise NoWorkers(f"no worker came within {self._timeout:g} s; start one with {self._invitation}")
        if alone > NOTICE and not self._told:
            self._told = True
            return self._line
        return None
