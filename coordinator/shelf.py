"""Frames and models that workers may still ask for; filled and read from different threads."""

from __future__ import annotations

import threading
from collections.abc import Callable

FRAMES = 2
MODELS = 4


class Shelf:
    """The last messages of each kind, by number and by hash."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: dict[str, bytes] = {}
        self._models: dict[str, bytes] = {}

    def put_frame(self, number: int, payload: bytes) -> None:
        """Keep a frame, and the one before it."""
        with self._lock:
            keep(self._frames, str(number), payload, FRAMES)

    def put_model(self, model_hash: str, encode: Callable[[], bytes]) -> None:
        """Keep a model; encoded only if it is new."""
        with self._lock:
            payload = self._models.get(model_hash)
            keep(self._models, model_hash, encode() if payload is None else payload, MODELS)

    def frame(self, number: str) -> bytes | None:
        """The message of a frame."""
        with self._lock:
            return self._frames.get(number)

    def model(self, model_hash: str) -> bytes | None:
        """The message of a model."""
        with self._lock:
            return self._models.get(model_hash)


def keep(shelf: dict[str, bytes], key: str, payload: bytes, size: int) -> None:
    """Put a message last, and drop the first ones above `size`."""
    shelf.pop(key, None)
    shelf[key] = payload
    while len(shelf) > size:
        del shelf[next(iter(shelf))]
