"""Requests that wait at a worker: runs take turns, so that none waits for all of another's."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Generic, TypeVar

T = TypeVar("T")

MOST = 64  # requests that may wait


class Turns(Generic[T]):
    """First come, first served within a run; between runs, one of each in turn."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[str, deque[T]] = OrderedDict()  # whose turn it is first

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def put(self, run: str, request: T) -> T | None:
        """A request has come; a run that had none waiting comes last. Gives the one that makes room for it.

        That is, when too many wait, the oldest of the run that has most of them.
        """
        self._waiting.setdefault(run, deque()).append(request)
        if sum(map(len, self._waiting.values())) <= MOST:
            return None
        longest = max(self._waiting, key=lambda name: len(self._waiting[name]))
        oldest = self._waiting[longest].popleft()
        if not self._waiting[longest]:
            del self._waiting[longest]
        return oldest

    def take(self) -> T:
        """The next request; IndexError if none waits."""
        if not self._waiting:
            raise IndexError("no request waits")
        run, requests = self._waiting.popitem(last=False)
        request = requests.popleft()
        if requests:
            self._waiting[run] = requests
        return request

    def forget(self, run: str) -> list[T]:
        """Take out all requests of a run."""
        return list(self._waiting.pop(run, ()))
