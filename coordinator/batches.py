"""How a job is split into batches: as few as may be, as each costs a trip; but a lost one must not hurt."""

from __future__ import annotations

from itertools import pairwise
from math import ceil

LARGEST = 10  # particles of a batch


def split(particles: int, workers: int) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) of particles, of sizes that differ by one at most.

    Their number is a multiple of that of the workers, so that all end at about the same time.
    """
    workers = max(1, workers)
    rounds = ceil(particles / (workers * LARGEST))
    count = min(particles, workers * rounds)
    ends = [particles * k // max(1, count) for k in range(count + 1)]
    return list(pairwise(ends))
