"""What a worker keeps between requests so that it need not ask for it again; bounded, oldest out first."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

RUNS = 16
FRAMES_OF_RUN = 2


class Recent(Generic[K, V]):
    """The values that were used last, at most `size` of them."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._values: OrderedDict[K, V] = OrderedDict()

    def find(self, key: K, make: Callable[[], V]) -> V:
        """The value of a key; made, if it is not there."""
        value = self._values[key] if key in self._values else make()
        self.put(key, value)
        return value

    def put(self, key: K, value: V) -> None:
        """Keep a value, as the one that was used last."""
        self._values[key] = value
        self._values.move_to_end(key)
        while len(self._values) > self._size:
            self._values.popitem(last=False)

    def get(self, key: K) -> V | None:
        """The value of a key, if it is there."""
        return self._values.get(key)

    def __len__(self) -> int:
        return len(self._values)


class Arrivals:
    """The last published frames of each run as they came; filled and read from different threads."""

    def __init__(self) -> None:
        self._runs: Recent[str, Recent[int, bytes]] = Recent(RUNS)
        self._changed = threading.Condition()

    def put(self, run: str, number: int, payload: bytes) -> None:
        """A frame has come."""
        with self._changed:
            self._runs.find(run, lambda: Recent(FRAMES_OF_RUN)).put(number, payload)
            self._changed.notify_all()

    def wait(self, run: str, number: int, timeout: float) -> bytes | None:
        """A frame, if it is there or comes within the timeout (seconds)."""
        with self._changed:
            self._changed.wait_for(lambda: self._get(run, number) is not None, timeout)
            return self._get(run, number)

    def _get(self, run: str, number: int) -> bytes | None:
        frames = self._runs.get(run)
        return None if frames is None else frames.get(number)
