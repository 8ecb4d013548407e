"""What a worker remembers of runs: frames, observations and models, or else fetches from the run.

Bounded, by run; the least recently used goes first.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from common.body import BodyModel
from common.errors import BusError, ProtocolError
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.frames import decode_frame
from common.protocol.messages import RefineRequest
from common.protocol.models import decode_model
from common.settings import RefineSettings
from common.transport.bus import Bus

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
O = TypeVar("O")  # noqa: E741 - what is made of a frame

RUNS = 16
FRAMES_OF_RUN = 2
MODELS_OF_RUN = 16  # a start tries several sizes of a body at once


PATIENCE = 0.2  # seconds that a published frame may be behind the first request for it
FETCH_TIMEOUT = 2.0  # seconds


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


class Contents(Generic[O]):
    """Finds the frames and bodies of requests.

    Args:
        bus: Where they are fetched from, if they are not known.
        memory: Of the runs, where their frames arrive.
    """

    def __init__(self, bus: Bus, memory: Memory[O]) -> None:
        self._bus = bus
        self._memory = memory

    def frame(self, request: RefineRequest) -> SubjectFrame:
        """A frame from the subscription; from the run itself, if it does not come."""
        run, number = request.run, request.frame
        payload = self._memory.wait_for_frame(run, number, PATIENCE)
        return decode_frame(
            payload or self._fetch(keys.run_frame(run, number), f"frame {number} of run {run}")
        )

    def model(self, memory: RunMemory[O], request: RefineRequest) -> BodyModel:
        """The model of a request; from the run itself, if its memory does not have it."""
        model = memory.models.find(
            request.model_hash, lambda: self._fetch_model(request.run, request.model_hash)
        )
        if request.poses.shape[1] != len(model.dof_names):
            raise ProtocolError(
                f"poses have {request.poses.shape[1]} values, the model has {len(model.dof_names)}"
            )
        return model

    def _fetch_model(self, run: str, model_hash: str) -> BodyModel:
        name = f"model {model_hash[:12]} of run {run}"
        model = decode_model(self._fetch(keys.run_model(run, model_hash), name))
        if model.hash != model_hash:
            raise ProtocolError(f"asked for model {model_hash} and got {model.hash}")
        return model

    def _fetch(self, key: str, name: str) -> bytes:
        payload = self._bus.fetch(key, FETCH_TIMEOUT)
        if payload is None:
            raise BusError(f"nobody has {name}")
        return payload
