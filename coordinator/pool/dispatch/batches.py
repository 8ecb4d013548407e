"""How a job is split into batches: one a worker, as each costs a trip; more where parts of a share count."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heapreplace
from itertools import accumulate, pairwise
from math import ceil

from coordinator.pool.dispatch.workload import Batch, Worker, speeds_of

HAIR = 1e-9  # rounds; that rounding errors do not cost a whole one
LARGEST = 10  # particles of a batch for each lane, where a share comes in parts


def one_each(particles: int, workers: Sequence[Worker], after: Batch | None = None) -> list[Batch]:
    """A batch for each worker; those of a batch that came back begin where that begins."""
    first, sent = (0, 0) if after is None else (after.start, after.sent)
    ranges = split(particles, speeds_of(workers), [worker.lanes for worker in workers])
    return [Batch(first + start, first + stop, sent=sent) for start, stop in ranges]


def several_each(particles: int, spare: int, workers: Sequence[Worker]) -> list[Batch]:
    """Several batches for each worker, and one of their own for the last of the particles, that are spare."""
    needed = particles - spare
    ranges = split_in_parts(needed, speeds_of(workers))
    return [Batch(*ends) for ends in [*ranges, *([(needed, particles)] if spare else [])]]


def cut(batches: Sequence[Batch], most: int) -> list[Batch]:
    """The same, none yet sent, in batches of so many particles at the most: the same rounds for each."""
    rounds = max((ceil((batch.stop - batch.start) / most) for batch in batches), default=0)
    parts = [Batch(*part_of(batch, n, rounds)) for n in range(rounds) for batch in batches]
    return [part for part in parts if part.start < part.stop]


def part_of(batch: Batch, n: int, parts: int) -> tuple[int, int]:
    """Ends of the n-th of so many parts of a batch."""
    count = batch.stop - batch.start
    return batch.start + count * n // parts, batch.start + count * (n + 1) // parts


def split(particles: int, speeds: Sequence[float], lanes: Sequence[int]) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) of particles, one for each worker, so that all is done the soonest.

    A speed is that of a usual lane times the number of lanes. Each worker gets one particle at the least,
    and no worker but one more than `in_rounds` gives it. Without workers all is one range.
    """
    if not speeds:
        return [(0, particles)] if particles else []
    most = [max(1, can) for can in in_rounds(particles, speeds, lanes)]
    if particles < len(most):
        return [(n, n + 1) for n in range(particles)]
    rest, spare = particles - len(most), max(1, sum(most) - len(most))
    reached = accumulate((can - 1 for can in most), initial=0)
    return list(pairwise(n + int(rest * can / spare + 0.5) for n, can in enumerate(reached)))


def split_in_parts(particles: int, speeds: Sequence[float]) -> list[tuple[int, int]]:
    """The same in several ranges for each worker, where what is refined by a deadline counts."""
    speeds = speeds or [1.0]
    parts = max(1, ceil(particles / (sum(speeds) * LARGEST)))
    return in_proportion(particles, list(speeds) * parts)


def in_proportion(particles: int, speeds: Sequence[float]) -> list[tuple[int, int]]:
    """A range for each speed, as large as it is fast, and none empty while there are enough particles."""
    if particles < len(speeds):
        return [(n, n + 1) for n in range(particles)]
    total = sum(speeds)
    least = 1 if particles * min(speeds) < total else 0  # that each has beside its share of the rest
    rest = particles - least * len(speeds)
    reached = enumerate(accumulate(speeds, initial=0.0))
    return list(pairwise(least * n + int(rest * share / total + 0.5) for n, share in reached))


def in_rounds(particles: int, speeds: Sequence[float], lanes: Sequence[int]) -> list[int]:
    """How many particles each worker can refine in the least time in which all together can refine so many.

    Each lane refines one after the other, so that a worker's time goes by rounds: one particle above a whole
    round costs as much as another round. Speeds are as of `split`.
    """
    paces = [speed / count for speed, count in zip(speeds, lanes, strict=True)]
    time = particles / sum(speeds)
    rounds = [int(time * pace) for pace in paces]
    left = particles - sum(done * count for done, count in zip(rounds, lanes, strict=True))
    ends = [((done + 1) / pace, place) for place, (done, pace) in enumerate(zip(rounds, paces, strict=True))]
    heapify(ends)
    while left > 0:  # another round for who is done with it first
        time, place = ends[0]
        rounds[place] += 1
        left -= lanes[place]
        heapreplace(ends, ((rounds[place] + 1) / paces[place], place))
    return [count * int(time * pace + HAIR) for pace, count in zip(paces, lanes, strict=True)]
