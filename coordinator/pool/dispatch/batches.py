"""How particles are split into batches, one for each worker, by how fast the workers are."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from math import ceil, inf
from statistics import median

DEADLINE_BATCH = 10  # particles for each usual lane, where what is refined by a deadline counts
PACES_KEPT = 5  # batches: the median of their paces passes over what holds a worker up for once
FASTEST = 4  # times the usual speed, or as many times slower: each batch stays worth its trip


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
    paces: deque[float] = field(default_factory=lambda: deque(maxlen=PACES_KEPT))  # seconds, see `InFlight`
    answered_at: float = -inf  # last
    failures: int = 0  # in a row
    rests_until: float = -inf


@dataclass(slots=True, eq=False)
class InFlight:
    """A request that is not over."""

    worker: Worker
    batch: Batch
    sent_at: float

    @property
    def load(self) -> int:
        """Particles for each lane of the worker; its pace is the seconds that it takes for one of them."""
        return ceil((self.batch.stop - self.batch.start) / self.worker.lanes)

    def learn_pace(self, at: float) -> None:
        """It was answered at a time; its worker was busy with it since it was free for it."""
        worker = self.worker
        worker.paces.append((at - max(self.sent_at, worker.answered_at)) / self.load)
        worker.answered_at = at


def usual_pace(workers: Sequence[Worker]) -> float | None:
    """The median of the workers' paces, None where nothing is known."""
    paces = [median(worker.paces) for worker in workers if worker.paces]
    return median(paces) if paces else None


def speeds_of(workers: Sequence[Worker]) -> list[float]:
    """How fast each worker is; a usual lane is 1, and so is a lane of which little is known.

    In steps of a quarter: workers that are about as fast get the same share, so that all their lanes end in
    the same round.
    """
    known = [worker for worker in workers if len(worker.paces) == PACES_KEPT]
    usual = usual_pace(known) or 0.0
    speeds = {}
    for worker in known:
        ratio = usual / median(worker.paces) if any(worker.paces) and usual > 0.0 else 1.0
        speeds[worker.name] = min(max(round(FASTEST * ratio) / FASTEST, 1 / FASTEST), FASTEST)
    return [worker.lanes * speeds.get(worker.name, 1.0) for worker in workers]


def batches_of(
    particles: int, workers: Sequence[Worker], largest: int, *, by_deadline: bool = False
) -> list[Batch]:
    """All particles in batches for the workers in turn; more rounds of them where they would be too large."""
    speeds = speeds_of(workers) or [1.0]
    share = particles / sum(speeds)  # of a usual lane
    rounds = max(1, ceil(share / DEADLINE_BATCH if by_deadline else share * max(speeds) / largest))
    ranges = split(particles, speeds * rounds)
    while any(stop - start > largest for start, stop in ranges):  # by rounding, or by many lanes
        rounds += 1
        ranges = split(particles, speeds * rounds)
    return [Batch(start, stop) for start, stop in ranges]


def split(particles: int, speeds: Sequence[float]) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop), one for each speed, as large as it is fast; none is empty.

    Where there are fewer particles than speeds, the first ones get one each.
    """
    if particles < len(speeds):
        return [(n, n + 1) for n in range(particles)]
    total = sum(speeds)
    least = 1 if particles * min(speeds) < total else 0  # that each has beside its share of the rest
    rest = particles - least * len(speeds)
    reached = enumerate(accumulate(speeds, initial=0.0))
    return list(pairwise(least * n + int(rest * share / total + 0.5) for n, share in reached))
