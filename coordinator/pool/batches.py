"""How a job is split into batches: as few as may be, as each costs a trip; but a lost one must not hurt."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import ceil

LARGEST = 10  # particles of a batch of workers that are equally fast


def split(particles: int, speeds: Sequence[float]) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) of particles, for workers of these speeds one after the other.

    Their number is a multiple of that of the workers, and their sizes go with the speeds, so that all end at
    about the same time.
    """
    speeds = speeds or [1.0]
    rounds = max(1, ceil(particles / (len(speeds) * LARGEST)))
    if particles < len(speeds) * rounds:
        return [(n, n + 1) for n in range(particles)]
    rest = particles - len(speeds) * rounds  # beyond the one that every batch has
    reached = accumulate(rounds * list(speeds), initial=0.0)
    total = rounds * sum(speeds)
    ends = [k + round(rest * share / total) for k, share in enumerate(reached)]
    return list(pairwise(ends))
