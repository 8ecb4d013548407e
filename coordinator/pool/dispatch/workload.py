"""What each worker has to do: batches, requests in flight, and how fast and reliable it is."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import median

WINDOW = 2
PACES = 5  # batches, by whose median a worker's speed is judged: what holds it up for once is passed over
SHORTEST = 1e-6  # seconds a particle
MOST_UNLIKE = 4.0  # times that a worker is taken to be faster or slower than the usual one
STRIKES = 3  # failures in a row until a worker rests
REST, REST_MOST = 1.0, 30.0  # seconds; doubles each time


@dataclass(slots=True, eq=False)
class Batch:
    """Particles start..stop-1 of the job."""

    start: int
    stop: int
    done: bool = False
    sent: int = 0
    came_back: bool = False  # without a result, and was not split since
    refusals: list[tuple[str, str]] = field(default_factory=list)  # worker, reason

    def is_refused_by(self, worker: Worker) -> bool:
        """Whether a worker has refused it, and may do so again."""
        return worker.name in {name for name, _ in self.refusals}


@dataclass(slots=True, eq=False)
class Worker:
    """A worker that is there."""

    name: str
    lanes: int = 1  # particles that it refines at once
    flights: dict[int, Flight] = field(default_factory=dict)  # by ticket
    paces: deque[float] = field(default_factory=lambda: deque(maxlen=PACES))  # seconds a particle, lately
    answered_at: float = float("-inf")  # last
    strikes: int = 0
    rests: int = 0
    rests_until: float = float("-inf")


@dataclass(slots=True, eq=False)
class Flight:
    """A request that is not over."""

    worker: Worker
    batch: Batch
    sent_at: float

    @property
    def load(self) -> int:
        """Particles for each lane of the worker."""
        return -(-(self.batch.stop - self.batch.start) // self.worker.lanes)


Rank = tuple[int, int, Worker]  # how busy, and its place among all


def clip(speed: float) -> float:
    """A speed so near to the usual one that each batch is worth its trip, and a slow worker may recover."""
    return min(max(speed, 1.0 / MOST_UNLIKE), MOST_UNLIKE)


def speeds_of(workers: Sequence[Worker]) -> list[float]:
    """How fast each worker is; a usual lane is 1, and so is a lane of which little is known."""
    paces = [median(w.paces) if len(w.paces) == PACES else None for w in workers]
    usual = max(SHORTEST, median([pace for pace in paces if pace is not None] or [SHORTEST]))
    return [
        worker.lanes * (1.0 if pace is None else clip(usual / max(SHORTEST, pace)))
        for worker, pace in zip(workers, paces, strict=True)
    ]


def rank(workers: Iterable[Worker], now: float) -> list[Rank]:
    """A heap of the workers that do not rest, the least busy on top, and of equally busy ones the first."""
    ranks = [(len(w.flights), place, w) for place, w in enumerate(workers) if w.rests_until <= now]
    heapq.heapify(ranks)
    return ranks


def least_busy(ranks: list[Rank]) -> Worker | None:
    """The one on top, where all have their right rank; None if it has all it may have in flight."""
    while ranks:
        busy, place, worker = ranks[0]
        if busy == len(worker.flights):
            return worker if busy < WINDOW else None
        heapq.heapreplace(ranks, (len(worker.flights), place, worker))  # it was sent something since
    return None


def strike(worker: Worker, now: float) -> None:
    """Count a failure; too many in a row, and the worker rests."""
    worker.strikes += 1
    if worker.strikes >= STRIKES:
        worker.rests_until = now + min(REST_MOST, REST * 2.0**worker.rests)
        worker.strikes, worker.rests = 0, worker.rests + 1
