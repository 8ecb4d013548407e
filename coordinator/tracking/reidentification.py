"""Re-identifies lost bodies among the candidates, by position and by the colour of their clothes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from gepf.common.arrays import Array
from gepf.coordinator.colour.clothes import Clothes, alike_nats
from gepf.coordinator.tracking.track_state import Policy


class LostBody(NamedTuple):
    """A lost body: where it was last seen, how long ago, and what is remembered about the clothes."""

    place: Array  # (3,) metres
    unseen_s: float
    clothes: Clothes | None = None


class SeenCandidate(NamedTuple):
    """A candidate: where it is, and the colour (3,) of the clothes; None if unknown."""

    place: Array  # (3,) metres
    clothes: Array | None = None


def assign_lost(
    lost: Sequence[LostBody], seen: Sequence[SeenCandidate], policy: Policy, *, may_refuse: bool = False
) -> list[int | None]:
    """The index of the candidate of each lost body: the most likely assignment of all of them.

    The place of a lost body is normally distributed; its standard deviation grows with time, up to
    `room_m`. With `may_refuse` (a candidate may be somebody new), a body whose clothes were seen for
    `unlike_s` refuses candidates in other clothes.
    """
    if not (lost and seen):
        return [None] * len(lost)
    track, colour = policy.settings, policy.colour.clothes
    deviation = np.array(
        [min(track.max_motion_m + track.walking_m_per_s * body.unseen_s, track.room_m) for body in lost]
    )
    away = np.linalg.norm([[candidate.place - body.place for candidate in seen] for body in lost], axis=-1)
    log_place = -0.5 * (away / deviation[:, None]) ** 2 - 3.0 * np.log(deviation[:, None])
    alike = np.array(
        [[alike_nats(body.clothes, candidate.clothes, colour) for candidate in seen] for body in lost]
    )
    is_well_known = [body.clothes is not None and body.clothes.seen_s >= colour.unlike_s for body in lost]
    refused = may_refuse & np.array(is_well_known)[:, None] & (alike < -colour.unlike_nats)
    score = log_place + alike
    ruled_out = score.min() - score.size * (np.ptp(score) + 1.0)  # worse than any assignment without refusals
    people, chosen = linear_sum_assignment(np.where(refused, ruled_out, score), maximize=True)
    taken = {int(n): int(k) for n, k in zip(people, chosen, strict=True) if not refused[n, k]}
    return [taken.get(n) for n in range(len(lost))]
