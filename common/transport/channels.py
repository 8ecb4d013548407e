"""Published messages, and requests to a worker, on both sides."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

import zenoh
from zenoh import handlers

from gepf.common.closing import Closing
from gepf.common.errors import BusError

ANSWER_S = 2.0  # for quick answers of other programs
Ending = Literal["reply", "refusal", "nothing"]
"""How a request ended: with a result, with a refusal and its reason, or without an answer."""


@contextmanager
def mapped(doing: str) -> Iterator[None]:
    """Convert errors of Zenoh to BusError, without the positions in Zenoh's source code that they name."""
    try:
        yield
    except zenoh.ZError as error:
        raise bus_error(doing, error) from error


def bus_error(doing: str, error: zenoh.ZError) -> BusError:
    """An error of Zenoh as BusError, without the position in Zenoh's source code that it names."""
    message = re.split(r"\.? at /", str(error), maxsplit=1)[0]
    return BusError(f"{doing}: {message}")


class Publisher:
    """Publishes messages; they are dropped if the link is overloaded."""

    def __init__(self, session: zenoh.Session, publisher: zenoh.Publisher) -> None:
        self._session = session
        self._publisher = publisher

    @property
    def has_subscriber(self) -> bool:
        """Whether there is a subscriber."""
        with mapped("looking for listeners"):
            return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]

    def put(self, payload: bytes, attachment: bytes | None = None) -> None:
        """Publish a message, with an attachment that other protocols need."""
        with mapped(f"publishing on {self._publisher.key_expr}"):
            self._publisher.put(payload, attachment=attachment)

    def put_blocking(self, payload: bytes) -> None:
        """Publish a message that waits if the link is overloaded."""
        with mapped(f"publishing on {self._publisher.key_expr}"):
            key, block = self._publisher.key_expr, zenoh.CongestionControl.BLOCK
            self._session.put(key, payload, congestion_control=block)


class IncomingRequest(Closing):
    """One request, a context manager; it ends without an answer unless `reply` or `refuse` is called."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.payload = b"" if query.payload is None else query.payload.to_bytes()

    def close(self) -> None:
        """End the request."""
        self._query.drop()  # type: ignore[no-untyped-call]

    def reply(self, payload: bytes) -> None:
        """Answer the request."""
        with mapped("replying"):
            self._query.reply(self._query.key_expr, payload)

    def refuse(self, payload: bytes) -> None:
        """Refuse the request with a reason."""
        with mapped("replying"):
            self._query.reply_err(payload)


class RequestSender:
    """Sends requests to one worker."""

    def __init__(self, querier: zenoh.Querier) -> None:
        self._querier = querier

    def send(self, payload: bytes, on_end: Callable[[Ending, bytes], None]) -> None:
        """Send a request. `on_end(ending, payload)` is called once, on a thread of the bus.

        Only the first of several answers is used.
        """
        ended = False

        def end(ending: Ending, payload: bytes = b"") -> None:
            nonlocal ended
            if not ended:
                ended = True
                on_end(ending, payload)

        def receive(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                end("reply", reply.ok.payload.to_bytes())
            elif reply.err is not None:
                end("refusal", reply.err.payload.to_bytes())

        callback = handlers.Callback(receive, drop=lambda: end("nothing"), indirect=False)
        try:  # not `mapped`, which is too slow for every batch
            self._querier.get(callback, payload=payload)
        except zenoh.ZError as error:
            raise bus_error("sending a request", error) from error

    def close(self) -> None:
        """Stop sending requests."""
        with mapped("closing a querier"):
            self._querier.undeclare()  # type: ignore[no-untyped-call]
