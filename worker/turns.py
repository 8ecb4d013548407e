"""Fair turns of runs at a worker: a state machine without a clock or threads.

The next turn is that of the run that was served for the shortest time (start-time fair queueing: Goyal, Vin
and Cheng, 1997). A run that had nothing to do starts with the time of the run that is being served, so it
cannot save up turns. While a run waits, no other is served for longer than it, up to one turn of each.

Spare work is that of searches. In a run it comes after other work. It is done beside the turns, in the time
that they leave. Only while another run waits for a turn does a run with only spare work take turns, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

W = TypeVar("W")

AWAY_S = 1.0  # service of other runs after which a run without work no longer counts


@dataclass(slots=True)
class Waiting(Generic[W]):
    """What a run waits for."""

    urgent: deque[W] = field(default_factory=deque)
    spare: deque[W] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self.urgent) + len(self.spare)


class Shares:
    """The time for which each run was served, in seconds of one worker."""

    def __init__(self) -> None:
        self._served: dict[str, float] = {}
        self._clock = 0.0  # time of the run that was served last, when its turn began

    def join(self, run: str) -> None:
        """Enter a run that had nothing to do and now has work."""
        self._served[run] = max(self._served.pop(run, 0.0), self._clock)

    def first(self, runs: Iterable[str]) -> str:
        """Of these runs, the one that comes next: of equals, the one that has waited longest."""
        wanted = set(runs)
        return min((run for run in self._served if run in wanted), key=self._served.__getitem__)

    def begin(self, run: str) -> None:
        """Begin the turn of a run."""
        self._clock = max(self._clock, self._served[run])

    def charge(self, run: str, seconds: float) -> None:
        """Charge a run for the time for which it was served; of runs with equal times, it now comes last."""
        if run in self._served:
            self._served[run] = self._served.pop(run) + seconds

    def forget(self, run: str) -> None:
        """Forget a run that has ended, or has had no work for long."""
        self._served.pop(run, None)


class Turns(Generic[W]):
    """What waits at a worker, and whose turn it is."""

    def __init__(self) -> None:
        self._waiting: dict[str, Waiting[W]] = {}  # of runs with work
        self._turns, self._spare = Shares(), Shares()  # of the foreground, and beside it
        self._total = 0.0  # seconds of all turns
        self._seen: dict[str, float] = {}  # by run: the total when it last had work

    def count(self, run: str) -> int:
        """Number of pieces of work of a run that wait."""
        return len(self._waiting.get(run, ()))

    def put(self, run: str, work: W, *, spare: bool = False, first: bool = False) -> None:
        """Queue work of a run; `first` for the rest of a piece of work that was begun."""
        if run not in self._waiting:
            self._waiting[run] = Waiting()
            self._turns.join(run)
        mine, self._seen[run] = self._waiting[run], self._total
        queue = mine.spare if spare else mine.urgent
        if spare and not queue:
            self._spare.join(run)
        queue.appendleft(work) if first else queue.append(work)

    def take(self) -> tuple[str, W] | None:
        """The run whose turn it is, and its work; None if there is only spare work, or no work."""
        if not any(mine.urgent for mine in self._waiting.values()):
            return None
        run = self._turns.first(self._waiting)
        self._turns.begin(run)
        mine = self._waiting[run]
        return run, self._pop(run, mine.urgent or mine.spare)

    def take_spare(self) -> tuple[str, W] | None:
        """The run whose turn it is beside the others, and its spare work; None if there is none."""
        runs = [run for run, mine in self._waiting.items() if mine.spare]
        if not runs:
            return None
        run = self._spare.first(runs)
        self._spare.begin(run)
        return run, self._pop(run, self._waiting[run].spare)

    def charge(self, run: str, seconds: float, beside: float | None = None) -> None:
        """Charge a run for `seconds` of the worker; for spare work also for `beside` seconds of a lane."""
        self._total += seconds
        self._turns.charge(run, seconds)
        if run in self._seen:
            self._seen[run] = self._total
        if beside is not None:
            self._spare.charge(run, beside)

    def is_alone(self, run: str) -> bool:
        """Whether no other run has had work lately."""
        away = {other for other, total in self._seen.items() if total < self._total - AWAY_S}
        for other in away - self._waiting.keys() - {run}:
            self._forget(other)
        return self._seen.keys() <= {run}

    def drop(self, run: str) -> list[W]:
        """Forget a run that has ended; returns the work that it waited for."""
        self._forget(run)
        mine = self._waiting.pop(run, None)
        return [] if mine is None else [*mine.urgent, *mine.spare]

    def _forget(self, run: str) -> None:
        for shares in (self._turns, self._spare):
            shares.forget(run)
        self._seen.pop(run, None)

    def _pop(self, run: str, queue: deque[W]) -> W:
        work = queue.popleft()
        if not self._waiting[run]:
            del self._waiting[run]
        return work
