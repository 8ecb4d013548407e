"""How a job is split into batches: one a worker, as each costs a trip; more where parts of a share count."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import ceil

LARGEST = 10  # particles of a batch for each lane, where a share comes in parts


def split(particles: int, speeds: Sequence[float], *, in_parts: bool = False) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) of particles, for workers of these speeds one after the other.

    A speed is that of a usual lane times the number of lanes. Sizes go with the speeds, so that all end at
    about the same time. There is one batch for each worker, or a multiple of that where shares come in parts.
    """
    speeds = speeds or [1.0]
    rounds = max(1, ceil(particles / (sum(speeds) * LARGEST))) if in_parts else 1
    if particles < len(speeds) * rounds:
        return [(n, n + 1) for n in range(particles)]
    total = rounds * sum(speeds)
    least = 1 if particles * min(speeds) < total else 0  # that every batch has beside its share of the rest
    rest = particles - least * len(speeds) * rounds
    reached = accumulate(rounds * list(speeds), initial=0.0)
    ends = [least * k + int(rest * share / total + 0.5) for k, share in enumerate(reached)]
    return list(pairwise(ends))
