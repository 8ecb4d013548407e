"""The cache of a worker: frames by number and models by hash. Missing ones are fetched from the run.

Frames of a run are received from its first request on. When many have come without a request, the worker
receives no more of them, until there is a request again. All sizes are bounded; the least recently used entry
is dropped first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import msgspec

from gepf.common.body import BodyModel
from gepf.common.errors import BusError, ProtocolError
from gepf.common.frame import SubjectFrame
from gepf.common.protocol import keys
from gepf.common.protocol.frames import decode_frame, number_of
from gepf.common.protocol.messages import RefineRequest
from gepf.common.protocol.models import decode_model
from gepf.common.recent import FRAMES_KEPT, MODELS_KEPT, put_recent
from gepf.common.settings import RefineSettings
from gepf.common.transport.bus import Bus


class MemoryLimits(msgspec.Struct, frozen=True):
    """What a worker keeps, and what it waits for."""

    frame_delay_s: float = 0.2  #: longest delay of a published frame after the first request for it
    frames: int = 16 * FRAMES_KEPT  #: of all runs; of each run at least two, the present one and the next
    runs: int = 256
    unasked: int = 32  #: frames of a run without a request: those of a second, or of many people


LIMITS = MemoryLimits()


@dataclass(slots=True, eq=False)
class RunMemory:
    """The cached data of one run."""

    frames: dict[int, bytes] = field(default_factory=dict)  # by number, encoded, not observed yet
    observations: dict[int, Any] = field(default_factory=dict)  # by number
    settings: RefineSettings | None = None  # of the latest request
    newest: int = -1  # number of a published frame
    unasked: int = 0  # frames since the latest request
    unsubscribe: Callable[[], None] | None = None


class Memory:
    """The cached data of all runs, for several threads.

    Args:
        bus: For subscribing to frames, and for fetching frames and models.
        observe: Converts a frame to an observation, prepared for requests with the settings.
        on_frame: Called with the run of a published frame, on a thread of the bus.
    """

    def __init__(
        self,
        bus: Bus,
        observe: Callable[[SubjectFrame, RefineSettings], Any],
        on_frame: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._bus = bus
        self._observe = observe
        self._on_frame = on_frame
        self._runs: dict[str, RunMemory] = {}
        self._gone: list[RunMemory] = []  # not needed, but still subscribed
        self._models: dict[str, BodyModel] = {}  # by hash
        self._busy: list[tuple[str, int] | str] = []  # frames and models that threads are getting
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Number of known runs."""
        return len(self._runs)

    def forget(self, run: str) -> None:
        """Drop the data of a run that has ended; callable on a thread of the bus."""
        with self._changed:
            self._drop(run)

    def unsubscribe(self) -> None:
        """Receive no more frames of runs that have been dropped; not callable on a thread of the bus."""
        with self._changed:
            gone, self._gone = self._gone, []
        for memory in gone:
            end, memory.unsubscribe = memory.unsubscribe, None
            if end is not None:
                end()

    def observation(self, request: RefineRequest) -> Any:
        """The observation of a request's frame.

        Raises ProtocolError for an invalid frame, BusError if it is not found.
        """
        run, number, particles = request.run, request.frame, request.particles
        memory = self._asked(run, particles.settings)
        with self._getting((run, number), waits=particles.spare):
            try:
                return self._observed(memory, run, number, particles.settings)
            except BusError:
                with self._changed:
                    unused = not (memory.frames or memory.observations)
                    if unused and self._runs.get(run) is memory:  # the run has probably ended
                        self._drop(run)
                raise

    def observe_ahead(self, run: str) -> None:
        """Observe a run's newest frame in advance, with the settings of its last request, if it had one."""
        with ExitStack() as claim:
            with self._changed:
                memory = self._runs.get(run)
                if memory is None or memory.settings is None:
                    return
                number, settings = memory.newest, memory.settings
                if number not in memory.frames or (run, number) in self._busy:
                    return
                claim.enter_context(self._getting((run, number), waits=False))
            self._observed(memory, run, number, settings)

    def model(self, request: RefineRequest) -> BodyModel:
        """A request's model.

        Raises ProtocolError if it is invalid or does not fit the poses, BusError if it is not found.
        """
        wanted = request.model
        with self._getting(wanted, waits=request.particles.spare):
            model = self._models.get(wanted)
            if model is None:
                name = f"model {wanted[:12]} of run {request.run}"
                model = decode_model(self._fetch(keys.of_run(request.run, f"model/{wanted}"), name))
                if model.hash != wanted:
                    raise ProtocolError(f"asked for model {wanted} and got {model.hash}")
            with self._changed:
                put_recent(self._models, wanted, model, max(4, len(self._runs)) * MODELS_KEPT)
        values = request.particles.poses.shape[1]
        if values != len(model.dof_names):
            raise ProtocolError(f"poses have {values} values, but the model has {len(model.dof_names)}")
        return model

    def _asked(self, run: str, settings: RefineSettings) -> RunMemory:
        """The data of a run that has a request; from now on, its frames are received."""
        with self._changed:
            memory = self._runs.get(run)
            is_new = memory is None
            memory = put_recent(self._runs, run, memory or RunMemory(), len(self._runs) + 1)
            memory.settings, memory.unasked = settings, 0
            if len(self._runs) > LIMITS.runs:
                self._drop(next(iter(self._runs)))
        if is_new:
            try:
                end = self._bus.subscribe(keys.of_run(run, "frame"), self._keep)
            except BusError:
                self.forget(run)
                raise
            with self._changed:
                memory.unsubscribe = end
                if self._runs.get(run) is not memory:  # it was dropped meanwhile
                    self._gone.append(memory)
        return memory

    def _keep(self, key: str, payload: bytes) -> None:
        """Keep a published frame, and wake the thread that waits for it; called on a thread of the bus."""
        run = keys.run_of(key)
        with suppress(ProtocolError):  # its requests report the error
            number = number_of(payload)
            with self._changed:
                memory = self._runs.get(run)
                if memory is None:
                    return
                memory.newest, memory.unasked = max(memory.newest, number), memory.unasked + 1
                if memory.unasked > LIMITS.unasked:
                    self._drop(run)
                    return
                put_recent(memory.frames, number, payload, self._kept)
                self._changed.notify_all()
            self._on_frame(run)

    def _drop(self, run: str) -> None:
        """Forget a run; its subscription is ended by `unsubscribe`."""
        memory = self._runs.pop(run, None)
        if memory is not None:
            self._gone.append(memory)

    @property
    def _kept(self) -> int:
        """Number of frames that are kept of each run."""
        return max(2, min(FRAMES_KEPT, LIMITS.frames // max(1, len(self._runs))))

    @contextmanager
    def _getting(self, what: tuple[str, int] | str, *, waits: bool) -> Iterator[None]:
        """Context for getting a frame or model; with `waits`, after other threads that get the same."""
        with self._changed:
            self._changed.wait_for(lambda: not waits or what not in self._busy)
            self._busy.append(what)
        try:
            yield
        finally:
            with self._changed:
                self._busy.remove(what)
                self._changed.notify_all()

    def _observed(self, memory: RunMemory, run: str, number: int, settings: RefineSettings) -> Any:
        with self._changed:
            if number in memory.observations:
                return put_recent(memory.observations, number, memory.observations[number], self._kept)
            if memory.newest >= 0:  # numbers ascend, so an older one does not come any more
                self._changed.wait_for(lambda: number <= memory.newest, LIMITS.frame_delay_s)
            payload = memory.frames.get(number)
        if payload is None:
            payload = self._fetch(keys.of_run(run, f"frame/{number}"), f"frame {number} of run {run}")
        observation = self._observe(decode_frame(payload), settings)
        with self._changed:
            memory.frames.pop(number, None)
            return put_recent(memory.observations, number, observation, self._kept)

    def _fetch(self, key: str, name: str) -> bytes:
        payload = self._bus.fetch(key)
        if payload is None:
            raise BusError(f"{name} is not available")
        return payload
