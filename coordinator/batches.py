"""How a job is split into batches: small enough to keep all workers busy, large enough to be worth a trip."""

from __future__ import annotations

from itertools import pairwise
from math import ceil

LARGEST = 10  # particles of a batch
ROUNDS = 2  # batches for each worker, where that leaves them large enough
SMALLEST_OF_MANY = 5  # particles of a batch, where a worker gets several


def split(particles: int, workers: int) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) of particles, of sizes that differ by one at most.

    Their number is a multiple of that of the workers, so that all end at about the same time.
    """
    workers = max(1, workers)
    share = ceil(particles / workers)
    rounds = max(1, ceil(share / LARGEST), min(ROUNDS, share // SMALLEST_OF_MANY))
    count = min(particles, workers * rounds)
    ends = [particles * k // max(1, count) for k in range(count + 1)]
    return list(pairwise(ends))
