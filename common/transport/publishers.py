"""Senders of what is published: frames under their numbers, and messages."""

from __future__ import annotations

import re

import zenoh
from zenoh import ext

from common.transport.zenoh_errors import mapped


class FramePublisher:
    """Publishes frames under their numbers."""

    def __init__(self, publisher: ext.AdvancedPublisher) -> None:
        self._publisher = publisher

    def put(self, number: int, payload: bytes) -> None:
        """Publish one frame. A subscriber that is too slow for it can fetch it by number."""
        with mapped("publishing a frame"):
            self._publisher.put(payload, attachment=str(number))


class Publisher:
    """Publishes messages; what an overloaded link cannot take is dropped."""

    def __init__(self, session: zenoh.Session, publisher: zenoh.Publisher) -> None:
        self._session = session
        self._publisher = publisher

    @property
    def followed(self) -> bool:
        """Whether anybody listens."""
        with mapped("looking for listeners"):
            return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]

    def put(self, payload: bytes) -> None:
        """Publish a message."""
        with mapped(f"publishing on {self._publisher.key_expr}"):
            self._publisher.put(payload)

    def put_surely(self, payload: bytes) -> None:
        """Publish a message that waits for its turn on an overloaded link."""
        with mapped(f"publishing on {self._publisher.key_expr}"):
            key, block = self._publisher.key_expr, zenoh.CongestionControl.BLOCK
            self._session.put(key, payload, congestion_control=block)


def number_of(attachment: zenoh.ZBytes | None) -> int | None:
    """A frame's number from its attachment; None where that is no number."""
    text = b"" if attachment is None else attachment.to_bytes()
    return int(text) if re.fullmatch(rb"[0-9]{1,15}", text) else None
