"""One request for refinement: it goes out in batches, and comes back in the order of its particles."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from common.bounds import most_covariances
from common.protocol.messages import RefineRequest, decode_refined
from common.refinement import Refined, concatenate
from coordinator.pool.dispatch.events import MOST_TOGETHER


@dataclass(slots=True, eq=False)
class Refinement:
    """What is asked for, and what has been answered of it."""

    request: RefineRequest  # for all particles
    due: float = math.inf  # when to do with the particles that are answered, by the monotonic clock
    spare: int = 0  # of the particles, the last: can be done without when the rest is due
    complete: bool = False
    _received: dict[int, Refined] = field(default_factory=dict)  # by ticket
    _parts: dict[int, Refined] = field(default_factory=dict)  # by first particle

    @property
    def particles(self) -> int:
        """How many are to be refined."""
        return len(self.request.poses)

    @property
    def most(self) -> int:
        """How many of them one reply may be about."""
        dofs = self.request.poses.shape[1]
        return min(MOST_TOGETHER, most_covariances(dofs)) if self.request.covariance else MOST_TOGETHER

    def is_due(self, now: float) -> bool:
        """Whether to do with what has been answered; the first answer about what is needed is waited for."""
        needed = self.particles - self.spare
        return now >= self.due and any(start < needed for start in self._parts)

    def receive(self, ticket: int, payload: bytes, particles: int) -> None:
        """Keep a batch's answer until it is accepted; ProtocolError if it makes no sense."""
        asked = particles, self.request.poses.shape[1]
        self._received[ticket] = decode_refined(payload, asked, covariance=self.request.covariance)

    def accept(self, ticket: int, start: int) -> None:
        """An answer is the first for the particles from `start` on."""
        self._parts[start] = self._received.pop(ticket)

    def gather(self) -> Refined:
        """What has been answered, in the order of the particles, and NaN for the rest."""
        if len(self._parts) == 1 and self.complete:
            return self._parts[0]
        parts: list[Refined] = []
        stop = 0
        for start, part in [*sorted(self._parts.items()), (self.particles, None)]:
            if start > stop:
                parts.append((part or parts[-1]).unanswered(start - stop))
            if part is not None:
                parts.append(part)
                stop = start + len(part.poses)
        return concatenate(parts)
