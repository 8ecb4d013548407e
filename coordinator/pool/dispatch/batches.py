"""How particles are split into batches, one for each worker, by how many lanes the workers have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from math import ceil, inf

DEADLINE_BATCH = 10  # particles for each lane, where what is refined by a deadline counts


@dataclass(slots=True, eq=False)
class Batch:
    """Particles start..stop-1."""

    start: int
    stop: int
    done: bool = False
    sent: int = 0
    in_flight: int = 0
    came_back: bool = False  # without a result, and was not split since
    refusals: list[tuple[str, str]] = field(default_factory=list)  # worker, reason

    @property
    def waits(self) -> bool:
        """Whether it has no result and is with no worker."""
        return not (self.done or self.in_flight)


@dataclass(slots=True, eq=False)
class Worker:
    """A worker that is there."""

    name: str
    lanes: int = 1  # particles that it refines at once
    in_flight: dict[int, InFlight] = field(default_factory=dict)  # by ticket
    pace: float | None = None  # seconds for a particle of each lane, of its last batch
    rests_until: float = -inf


@dataclass(slots=True, eq=False)
class InFlight:
    """A request that is not over."""

    worker: Worker
    batch: Batch
    sent_at: float

    @property
    def load(self) -> int:
        """Particles for each lane of the worker."""
        return ceil((self.batch.stop - self.batch.start) / self.worker.lanes)


def batches_of(
    particles: int, workers: Sequence[Worker], largest: int, *, by_deadline: bool = False
) -> list[Batch]:
    """All particles in batches for the workers in turn; more rounds of them where they would be too large."""
    lanes = [worker.lanes for worker in workers] or [1]
    rounds = max(1, ceil(particles / sum(lanes) / DEADLINE_BATCH)) if by_deadline else 1
    ranges = split(particles, lanes * rounds)
    while any(stop - start > largest for start, stop in ranges):
        rounds += 1
        ranges = split(particles, lanes * rounds)
    return [Batch(start, stop) for start, stop in ranges]


def split(particles: int, lanes: Sequence[int]) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) as large as the numbers of lanes of the workers; none is empty."""
    total = sum(lanes)
    ends = [ceil(particles * share / total) for share in accumulate(lanes, initial=0)]
    return [(start, stop) for start, stop in pairwise(ends) if start < stop]
