"""What requests are about: frames and bodies, remembered, or fetched from the run."""

from __future__ import annotations

from typing import Generic, TypeVar

from common.body import BodyModel
from common.errors import BusError, ProtocolError
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.frames import decode_frame
from common.protocol.messages import RefineRequest
from common.protocol.models import decode_model
from common.sizes import Body, Sized, Sizes
from common.transport.bus import Bus
from worker.store import Memory, RunMemory

PATIENCE = 0.2  # seconds that a published frame may be behind the first request for it
FETCH_TIMEOUT = 2.0  # seconds

O = TypeVar("O")  # noqa: E741 - what is made of a frame


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

    def body(self, memory: RunMemory[O], request: RefineRequest) -> Body:
        """The body of a request's particles; from the run itself, if its memory does not have it."""
        model = self._model(memory, request.run, request.model_hash)
        if request.poses.shape[1] != len(model.dof_names):
            raise ProtocolError(
                f"poses have {request.poses.shape[1]} values, the model has {len(model.dof_names)}"
            )
        of = request.of_sizes
        if of is None:
            return model
        thick = self._model(memory, request.run, of.thick_hash)
        bodies = memory.sizes.find((request.model_hash, of.thick_hash), lambda: Sizes(model, thick))
        return Sized(bodies, of.sizes)

    def _model(self, memory: RunMemory[O], run: str, model_hash: str) -> BodyModel:
        return memory.models.find(model_hash, lambda: self._fetch_model(run, model_hash))

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
