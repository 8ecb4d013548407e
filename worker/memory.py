"""The cache of a worker: frames by number and models by hash. Missing ones are fetched from the run.

All sizes are bounded; the least recently used entry is dropped first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

from gepf.common.body import BodyModel
from gepf.common.errors import BusError, ProtocolError
from gepf.common.frame import SubjectFrame
from gepf.common.protocol import keys
from gepf.common.protocol.frames import decode_frame
from gepf.common.protocol.messages import RefineRequest
from gepf.common.protocol.models import decode_model
from gepf.common.recent import FRAMES_KEPT, MODELS_KEPT, put_recent
from gepf.common.settings import RefineSettings
from gepf.common.transport.bus import Bus

FRAME_DELAY_S = 0.2  # longest delay of a published frame after the first request for it


@dataclass(slots=True, eq=False)
class RunMemory:
    """The cached data of one run."""

    frames: dict[int, bytes] = field(default_factory=dict)  # by number, encoded
    observations: dict[int, Any] = field(default_factory=dict)  # by number
    settings: RefineSettings | None = None  # of the latest request


class Memory:
    """The cached data of all runs, for several threads.

    Args:
        bus: For fetching frames and models.
        observe: Converts a frame to an observation, prepared for requests with the settings.
    """

    def __init__(self, bus: Bus, observe: Callable[[SubjectFrame, RefineSettings], Any]) -> None:
        self._bus = bus
        self._observe = observe
        self._runs: dict[str, RunMemory] = {}
        self._models: dict[str, BodyModel] = {}  # by hash
        self._busy: list[tuple[str, int] | str] = []  # frames and models that threads get
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Number of known runs."""
        return len(self._runs)

    def put_frame(self, run: str, number: int, payload: bytes) -> None:
        """Keep an encoded frame, and wake the thread that waits for it."""
        with self._changed:
            put_recent(self._of(run).frames, number, payload, FRAMES_KEPT)
            self._changed.notify_all()

    def forget(self, run: str) -> None:
        """Drop the data of a run that has ended."""
        with self._changed:
            self._runs.pop(run, None)

    def observation(self, request: RefineRequest) -> Any:
        """The observation of a request's frame.

        Raises ProtocolError for an invalid frame, BusError if it is not found.
        """
        run, number, particles = request.run, request.frame, request.particles
        with self._changed:
            memory = self._of(run)
            memory.settings = particles.settings
        with self._getting((run, number), waits=particles.spare):
            try:
                return self._observed(memory, run, number, particles.settings)
            except BusError:
                with self._changed:
                    unused = not (memory.frames or memory.observations)
                    if unused and self._runs.get(run) is memory:  # the run has probably ended
                        del self._runs[run]
                raise

    def observe_ahead(self, run: str) -> None:
        """Observe a run's newest frame, for the settings of its probable request, if there was one before."""
        with ExitStack() as claim:
            with self._changed:
                memory = self._runs.get(run)
                if memory is None or memory.settings is None or not memory.frames:
                    return
                number, settings = list(memory.frames)[-1], memory.settings
                if (run, number) in self._busy:
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
                put_recent(self._models, wanted, model, 4 * MODELS_KEPT)  # of several runs
        values = request.particles.poses.shape[1]
        if values != len(model.dof_names):
            raise ProtocolError(f"poses of {values} values for a model of {len(model.dof_names)}")
        return model

    @contextmanager
    def _getting(self, what: tuple[str, int] | str, *, waits: bool) -> Iterator[None]:
        """Get a frame or model. A thread of low priority waits for others, so that it is not done twice."""
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
                return put_recent(memory.observations, number, memory.observations[number], FRAMES_KEPT)
            frames = memory.frames  # numbers ascend, so an older one does not come any more
            self._changed.wait_for(lambda: number <= max(frames, default=-1), FRAME_DELAY_S)
            payload = frames.get(number)
        if payload is None:
            payload = self._fetch(keys.of_run(run, f"frame/{number}"), f"frame {number} of run {run}")
        observation = self._observe(decode_frame(payload), settings)
        with self._changed:
            return put_recent(memory.observations, number, observation, FRAMES_KEPT)

    def _of(self, run: str) -> RunMemory:
        return put_recent(self._runs, run, self._runs.get(run) or RunMemory(), 16)

    def _fetch(self, key: str, name: str) -> bytes:
        payload = self._bus.fetch(key)
        if payload is None:
            raise BusError(f"{name} is not available")
        return payload
