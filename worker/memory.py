"""What a worker keeps of runs: frames by number and models by hash. What it lacks it fetches from the run.

All is bounded; what was used least recently goes first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from common.body import BodyModel
from common.errors import BusError, ProtocolError
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.frames import decode_frame
from common.protocol.messages import RefineRequest
from common.protocol.models import decode_model
from common.recent import FRAMES_KEPT, MODELS_KEPT, keep
from common.settings import RefineSettings
from common.transport.bus import Bus

RUNS_KEPT = 16
FRAME_DELAY_S = 0.2  # by which a published frame may come after the first request for it


@dataclass(slots=True, eq=False)
class RunMemory:
    """What is kept of one run."""

    frames: dict[int, bytes] = field(default_factory=dict)  # by number, encoded
    observations: dict[int, Any] = field(default_factory=dict)  # by number
    settings: RefineSettings | None = None  # of the latest request


class Memory:
    """What is kept of all runs. Frames arrive on a thread of the bus; the rest is for one thread.

    Args:
        bus: Where frames and models are fetched from.
        observe: What is made of a frame.
    """

    def __init__(self, bus: Bus, observe: Callable[[SubjectFrame], Any]) -> None:
        self._bus = bus
        self._observe = observe
        self._runs: dict[str, RunMemory] = {}
        self._models: dict[str, BodyModel] = {}  # by hash
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """How many runs it knows of."""
        return len(self._runs)

    def put_frame(self, run: str, number: int, payload: bytes) -> None:
        """Keep an encoded frame, and wake who waits for it."""
        with self._changed:
            keep(self._of(run).frames, number, payload, FRAMES_KEPT)
            self._changed.notify_all()

    def forget(self, run: str) -> None:
        """Drop what is kept of a run, which has ended."""
        with self._changed:
            self._runs.pop(run, None)

    def observation(self, request: RefineRequest) -> Any:
        """What a request's frame shows.

        Raises ProtocolError for a frame that makes no sense, BusError if it is not found.
        """
        run, number = request.run, request.frame
        with self._changed:
            memory = self._of(run)
            memory.settings = request.settings
            if number in memory.observations:
                return keep(memory.observations, number, memory.observations[number], FRAMES_KEPT)
            self._changed.wait_for(lambda: number in memory.frames, FRAME_DELAY_S)
            payload = memory.frames.get(number)
        if payload is None:
            payload = self._fetch(keys.of_run(run, f"frame/{number}"), f"frame {number} of run {run}")
        return keep(memory.observations, number, self._observe(decode_frame(payload)), FRAMES_KEPT)

    def observe_ahead(self, run: str) -> tuple[Any, RefineSettings] | None:
        """What a run's newest frame shows, and the settings it may be requested with.

        None if it was observed before, or the run has requested nothing yet.
        """
        with self._changed:
            memory = self._runs.get(run)
            if memory is None or memory.settings is None or not memory.frames:
                return None
            number, payload = list(memory.frames.items())[-1]
        if number in memory.observations:
            return None
        observation = keep(memory.observations, number, self._observe(decode_frame(payload)), FRAMES_KEPT)
        return observation, memory.settings

    def model(self, request: RefineRequest) -> BodyModel:
        """A request's model.

        Raises ProtocolError if it makes no sense or does not fit the poses, BusError if it is not found.
        """
        wanted = request.model_hash
        model = self._models.get(wanted)
        if model is None:
            name = f"model {wanted[:12]} of run {request.run}"
            model = decode_model(self._fetch(keys.of_run(request.run, f"model/{wanted}"), name))
            if model.hash != wanted:
                raise ProtocolError(f"asked for model {wanted} and got {model.hash}")
        keep(self._models, wanted, model, 4 * MODELS_KEPT)  # of several runs
        if request.poses.shape[1] != len(model.dof_names):
            raise ProtocolError(
                f"poses have {request.poses.shape[1]} values, the model has {len(model.dof_names)}"
            )
        return model

    def _of(self, run: str) -> RunMemory:
        return keep(self._runs, run, self._runs.get(run) or RunMemory(), RUNS_KEPT)

    def _fetch(self, key: str, name: str) -> bytes:
        payload = self._bus.fetch(key)
        if payload is None:
            raise BusError(f"nobody has {name}")
        return payload
