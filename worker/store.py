"""A worker's cache of frames, observations and models: bounded, by run, least recently used out first."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from common.body import BodyModel
from common.settings import RefineSettings
from common.sizes import Sizes

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
O = TypeVar("O")  # noqa: E741 - what is made of a frame

RUNS = 16
FRAMES_OF_RUN = 2
MODELS_OF_RUN = 6
SIZES_OF_RUN = 2


class Recent(Generic[K, V]):
    """A cache of at most `size` values; the least recently used goes first."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._values: OrderedDict[K, V] = OrderedDict()

    def find(self, key: K, make: Callable[[], V]) -> V:
        """Return the value of a key; make it if it is not there."""
        value = self._values[key] if key in self._values else make()
        self.put(key, value)
        return value

    def put(self, key: K, value: V) -> None:
        """Store a value as the most recently used."""
        self._values[key] = value
        self._values.move_to_end(key)
        while len(self._values) > self._size:
            self._values.popitem(last=False)

    def values(self) -> list[V]:
        """All values, the least recently used first."""
        return list(self._values.values())

    def get(self, key: K) -> V | None:
        """The value of a key, if it is there."""
        return self._values.get(key)

    def __contains__(self, key: K) -> bool:
        return key in self._values

    def forget(self, key: K) -> None:
        """Remove the value of a key, if it is there."""
        self._values.pop(key, None)

    def __len__(self) -> int:
        return len(self._values)


class RunMemory(Generic[O]):
    """The cache of one run."""

    def __init__(self) -> None:
        self.frames: Recent[int, bytes] = Recent(FRAMES_OF_RUN)  # encoded
        self.observations: Recent[int, O] = Recent(FRAMES_OF_RUN)
        self.models: Recent[str, BodyModel] = Recent(MODELS_OF_RUN)
        self.sizes: Recent[tuple[str, str], Sizes] = Recent(SIZES_OF_RUN)  # by the hashes of both models
        self.unread: int | None = None  # the newest frame, if it was not observed yet
        self.settings: RefineSettings | None = None  # of the latest request


class Memory(Generic[O]):
    """The caches of the runs that were busy last. Frames are stored and read by different threads."""

    def __init__(self) -> None:
        self._runs: Recent[str, RunMemory[O]] = Recent(RUNS)
        self._changed = threading.Condition()

    def of(self, run: str) -> RunMemory[O]:
        """The cache of a run."""
        with self._changed:
            return self._runs.find(run, RunMemory)

    def forget(self, run: str) -> None:
        """Remove the cache of a run, which has ended."""
        with self._changed:
            self._runs.forget(run)

    def put_frame(self, run: str, number: int, payload: bytes) -> None:
        """Store an encoded frame, and wake who waits for it."""
        with self._changed:
            memory = self._runs.find(run, RunMemory)
            memory.frames.put(number, payload)
            memory.unread = number
            self._changed.notify_all()

    def take_unread(self) -> tuple[RunMemory[O], int, bytes] | None:
        """Return, once, a frame that was not observed yet, of a run that has sent a request before."""
        with self._changed:
            for memory in self._runs.values():
                if memory.unread is not None and memory.models:
                    number, memory.unread = memory.unread, None
                    payload = memory.frames.get(number)
                    if payload is not None and number not in memory.observations:
                        return memory, number, payload
            return None

    def wait_for_frame(self, run: str, number: int, timeout: float) -> bytes | None:
        """Return a frame if it is there or comes within the timeout (seconds)."""
        with self._changed:
            self._changed.wait_for(lambda: self._get_frame(run, number) is not None, timeout)
            return self._get_frame(run, number)

    def _get_frame(self, run: str, number: int) -> bytes | None:
        memory = self._runs.get(run)
        return None if memory is None else memory.frames.get(number)

    def __len__(self) -> int:
        return len(self._runs)
