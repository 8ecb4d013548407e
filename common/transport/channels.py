"""What goes over a session: published frames and messages, and requests to a worker, on both sides."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh import ext, handlers

from common.errors import BusError

WAITING_REQUESTS = 64  # at one worker; the oldest is dropped, and so sent elsewhere
SIGNALS_S = 0.2  # between looks for a signal that came just before a wait, which it would not end
Payload = Callable[[bytes], None]


@contextmanager
def mapped(doing: str) -> Iterator[None]:
    """Turn Zenoh's errors into BusError, without the places in its sources."""
    try:
        yield
    except zenoh.ZError as error:
        raise bus_error(doing, error) from error


def bus_error(doing: str, error: zenoh.ZError) -> BusError:
    """An error of Zenoh's as one of ours."""
    return BusError(f"{doing}: {plain(str(error))}")


def plain(text: Any) -> str:
    """Zenoh's message up to where it names its own source files."""
    return re.split(r"\.? at /", str(text), maxsplit=1)[0]


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


class RequestReceiver:
    """Requests to a worker, oldest first, on their way from a thread of the bus to the worker's own."""

    def __init__(self) -> None:
        self.queryable: zenoh.Queryable[None] | None = None
        self._waiting: SimpleQueue[zenoh.Query | None] = SimpleQueue()  # None to wake the worker
        self._ended = False

    def put(self, query: zenoh.Query) -> None:
        """Add a query; the oldest is dropped if too many wait. Called on a thread of the bus."""
        if self._waiting.qsize() >= WAITING_REQUESTS:
            with suppress(Empty):
                oldest = self._waiting.get_nowait()
                if oldest is not None:
                    oldest.drop()  # type: ignore[no-untyped-call]
        self._waiting.put(query)

    def receive(self, *, wait: bool) -> list[IncomingRequest] | None:
        """All that wait; if there are none and `wait`, the first within a while. None after the end."""
        taken = []
        with suppress(Empty):
            taken.append(self._waiting.get(block=wait, timeout=SIGNALS_S))
            while len(taken) < WAITING_REQUESTS:
                taken.append(self._waiting.get_nowait())
        return None if self._ended else [IncomingRequest(query) for query in taken if query is not None]

    def wake(self) -> None:
        """Have `receive` return; may be called from another thread."""
        if self._waiting.empty():
            self._waiting.put(None)

    def end(self) -> None:
        """No more requests will come; may be called from another thread."""
        self._ended = True
        self.wake()

    def close(self) -> None:
        """Take no more requests; may be called from another thread."""
        self.end()
        if self.queryable is not None:
            with mapped("closing the queryable"):
                self.queryable.undeclare()  # type: ignore[no-untyped-call]


class IncomingRequest:
    """One request, a context manager; it ends without an answer if neither method is called."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.payload = b"" if query.payload is None else query.payload.to_bytes()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._query.drop()  # type: ignore[no-untyped-call]

    def reply(self, payload: bytes) -> None:
        """Answer it."""
        with mapped("replying"):
            self._query.reply(self._query.key_expr, payload)

    def refuse(self, payload: bytes) -> None:
        """Say why it cannot be answered."""
        with mapped("replying"):
            self._query.reply_err(payload)


class RequestSender:
    """Sends requests to one worker."""

    def __init__(self, querier: zenoh.Querier) -> None:
        self._querier = querier

    def send(
        self, payload: bytes, on_reply: Payload, on_refusal: Payload, on_end: Callable[[], None]
    ) -> None:
        """Send a request. It ends with an answer, of several the first one, or else `on_end` is called."""
        answered = False

        def receive(reply: zenoh.Reply) -> None:
            nonlocal answered
            if answered:
                return
            answered = True
            if reply.ok is not None:
                on_reply(reply.ok.payload.to_bytes())
            elif reply.err is not None:
                on_refusal(reply.err.payload.to_bytes())

        def end() -> None:
            if not answered:
                on_end()

        try:  # not `mapped`, which costs more than the rest: this is done for every batch
            self._querier.get(handlers.Callback(receive, drop=end, indirect=False), payload=payload)
        except zenoh.ZError as error:
            raise bus_error("sending a request", error) from error

    def close(self) -> None:
        """No more requests."""
        with mapped("closing a querier"):
            self._querier.undeclare()  # type: ignore[no-untyped-call]
