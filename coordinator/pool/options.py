"""Who may refine: workers of our own, and those that connect or are found behind a router."""

from __future__ import annotations

from dataclasses import dataclass

from common.cores import usable_cores
from common.transport.session import Security
from coordinator.pool.local_workers import COMMAND
from coordinator.pool.no_worker_timeout import PATIENCE, NoWorkerTimeout


@dataclass(frozen=True, slots=True)
class Pool:
    """The workers of a run."""

    workers: int | None = None  # lanes of the local worker; None for one per core, 0 for no local worker
    listen: str | None = None  # endpoint at which others may join
    connect: str | None = None  # endpoint of a router where others are
    security: Security | None = None
    worker_timeout: float | None = None  # seconds without any worker until we give up; None to wait for ever
    deadline: float | None = None  # seconds from publishing a frame until unanswered particles are left out
    run: str | None = None  # None to invent a name
    worker_command: tuple[str, ...] = COMMAND
    patience: float = PATIENCE  # seconds without any worker until that is reported
    asked: Pool | None = None  # what the user asked for, where runs share that and this leads to it

    @property
    def lanes(self) -> int:
        """Lanes of the local worker; 0 for none."""
        return usable_cores() if self.workers is None else self.workers

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        """Where others may join."""
        return (self.listen,) if self.listen else ()

    @property
    def connect_endpoints(self) -> tuple[str, ...]:
        """Where we join others."""
        return (self.connect,) if self.connect else ()


def no_worker_timeout(pool: Pool) -> NoWorkerTimeout:
    """What to report while no worker is there, and when to give up."""
    asked = pool.asked or pool
    missing = "no worker is there; waiting for one"
    if asked.lanes:
        missing = "the local worker is not ready yet; the first time it compiles for a minute or so"
    invitation = f"gepf-worker --connect {asked.listen or asked.connect or 'ENDPOINT'}"
    return NoWorkerTimeout(pool.worker_timeout, missing, invitation, pool.patience)
