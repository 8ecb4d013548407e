"""How a job is split into batches: one a worker, as each costs a trip; more where parts of a share count."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heapreplace
from itertools import accumulate, pairwise
from math import ceil

HAIR = 1e-9  # rounds; that rounding errors do not cost a whole one
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


def split_in_rounds(particles: int, speeds: Sequence[float], lanes: Sequence[int]) -> list[tuple[int, int]]:
    """As `split`, one range for each worker, and none of more than what `in_rounds` gives it, but one."""
    most = [max(1, can) for can in in_rounds(particles, speeds, lanes)]
    if particles < len(most):
        return [(n, n + 1) for n in range(particles)]
    rest, spare = particles - len(most), max(1, sum(most) - len(most))
    reached = accumulate((can - 1 for can in most), initial=0)
    return list(pairwise(n + int(rest * can / spare + 0.5) for n, can in enumerate(reached)))
