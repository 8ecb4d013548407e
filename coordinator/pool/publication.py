"""Makes frames and models known to workers, and keeps them for who missed them."""

from __future__ import annotations

import threading

from common.body import BodyModel
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.messages import encode_frame, encode_model
from common.transport.bus import Bus

FRAMES_KEPT = 2
MODELS_KEPT = 6


class Publication:
    """What one run has published. The bus reads it from threads of its own."""

    def __init__(self, bus: Bus, run: str) -> None:
        self.current = -1  # number of the frame that is to be refined on
        self._sent: SubjectFrame | None = None  # last
        self._number = -1  # under which it was sent
        self._offered: BodyModel | None = None  # last
        self._lock = threading.Lock()
        self._frames: dict[str, bytes] = {}  # by number
        self._models: dict[str, bytes] = {}  # by hash
        bus.serve(keys.run_frame(run, "*"), self._find_frame)
        bus.serve(keys.run_model(run, "*"), self._find_model)
        self._publisher = bus.publish_frames(keys.run_frames(run))

    def put(self, subject: SubjectFrame) -> None:
        """Make a frame the current one; send it, if that has not been done ahead."""
        if subject is not self._sent:
            self.put_ahead(subject)
        self.current = self._number

    def put_ahead(self, subject: SubjectFrame) -> None:
        """Send a frame under its number, or under the next one if that has been used."""
        self._sent, self._number = subject, max(subject.frame.number, self._number + 1)
        payload = encode_frame(subject)
        with self._lock:
            keep(self._frames, str(self._number), payload, FRAMES_KEPT)
        self._publisher.put(self._number, payload)

    def offer(self, model: BodyModel) -> None:
        """Have a model ready for who asks for it."""
        if model is self._offered:
            return
        self._offered = model
        with self._lock:
            known = self._models.get(model.hash)
            keep(self._models, model.hash, known or encode_model(model), MODELS_KEPT)

    def _find_frame(self, key: str) -> bytes | None:
        with self._lock:
            return self._frames.get(keys.last_of(key))

    def _find_model(self, key: str) -> bytes | None:
        with self._lock:
            return self._models.get(keys.last_of(key))


def keep(messages: dict[str, bytes], key: str, payload: bytes, size: int) -> None:
    """Put a message last, and drop the first ones above `size`."""
    messages.pop(key, None)
    messages[key] = payload
    while len(messages) > size:
        del messages[next(iter(messages))]
