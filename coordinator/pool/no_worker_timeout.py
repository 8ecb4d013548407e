"""How long there has been no worker: when to report it, and when to give up."""

from __future__ import annotations

from common.errors import NoWorkers

PATIENCE = 5.0  # seconds without a worker until it is reported


class NoWorkerTimeout:
    """Keeps time while there is no worker; has no clock of its own.

    Args:
        seconds: Without a worker until the wait is over; None for never.
        notice: What is reported after a while.
        invitation: The command that starts a worker.
        patience: Seconds without a worker until it is reported.
    """

    def __init__(
        self, seconds: float | None, notice: str, invitation: str, patience: float = PATIENCE
    ) -> None:
        self._seconds = seconds
        self._notice = notice
        self._invitation = invitation
        self._patience = patience
        self._since: float | None = None
        self._reported = False

    def reset(self) -> None:
        """A worker has come."""
        self._since, self._reported = None, False

    def check(self, now: float) -> str | None:
        """A line to report, once, if no worker has come for a while; NoWorkers if the wait is over."""
        self._since = now if self._since is None else self._since
        alone = now - self._since
        if self._seconds is not None and alone > self._seconds:
            self.reset()
            raise NoWorkers(f"no worker came within {self._seconds:g} s; start one with {self._invitation}")
        if alone > self._patience and not self._reported:
            self._reported = True
            return self._notice
        return None
