"""A fair queue of requests: runs take turns, so that none waits for all requests of another."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Generic, TypeVar

T = TypeVar("T")

MOST = 64  # requests that may wait


class FairQueue(Generic[T]):
    """Requests in the order they came within a run, and round-robin between runs."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[str, deque[T]] = OrderedDict()  # whose turn it is first

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def put(self, run: str, request: T) -> T | None:
        """Add a request; a run that had none waiting comes last. Returns the request dropped for it, if any.

        When too many wait, that is the oldest of the run that has most of them.
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
        """Remove the next request and return it; IndexError if none waits."""
        if not self._waiting:
            raise IndexError("no request waits")
        run, requests = self._waiting.popitem(last=False)
        request = requests.popleft()
        if requests:
            self._waiting[run] = requests
        return request

    def forget(self, run: str) -> list[T]:
        """Remove all requests of a run and return them."""
        return list(self._waiting.pop(run, ()))
