"""Publishes frames and serves models to workers, and keeps both for workers that missed them."""

from __future__ import annotations

import threading
from collections.abc import Collection
from dataclasses import replace

from common.body import BodyModel
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.frames import encode_frame
from common.protocol.models import encode_model
from common.recent import FRAMES_KEPT, MODELS_KEPT, put_recent
from common.transport.bus import Bus


class Publication:
    """The published frames and models of one run. Threads of the bus read it."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._number = -1  # of the last sent frame
        self._lock = threading.Lock()
        # By number, each with its message; the most recently used is last.
        self._frames: dict[int, tuple[SubjectFrame, bytes]] = {}
        self._models: dict[str, bytes] = {}  # by hash
        bus.serve(keys.of_run(run, "frame/*"), self._find_frame)
        bus.serve(keys.of_run(run, "model/*"), self._find_model)
        bus.serve(keys.of_run(run, "present"), lambda _: b"")
        self._publisher = bus.publish(keys.of_run(run, "frame"))

    def put(self, subject: SubjectFrame, needed: Collection[int] = ()) -> int:
        """Send a frame with its number, or with the next one if that is used; returns the number.

        A frame that was sent recently is not sent again. Recent frames and the `needed` ones are kept.
        """
        number = next((n for n, (sent, _) in self._frames.items() if sent is subject), None)
        if number is not None:
            with self._lock:
                put_recent(self._frames, number, self._frames[number], FRAMES_KEPT, needed)
            return number
        self._number = max(subject.frame.number, self._number + 1)
        payload = encode_frame(replace(subject, frame=replace(subject.frame, number=self._number)))
        with self._lock:
            put_recent(self._frames, self._number, (subject, payload), FRAMES_KEPT, needed)
        self._publisher.put(payload)
        return self._number

    def offer(self, model: BodyModel) -> None:
        """Keep a model for workers that fetch it."""
        with self._lock:
            known = self._models.get(model.hash)
            put_recent(self._models, model.hash, known or encode_model(model), MODELS_KEPT)

    def _find_frame(self, key: str) -> bytes | None:
        with self._lock:
            number = keys.last_of(key)
            return next((payload for n, (_, payload) in self._frames.items() if str(n) == number), None)

    def _find_model(self, key: str) -> bytes | None:
        with self._lock:
            return self._models.get(keys.last_of(key))
