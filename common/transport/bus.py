"""One session on the bus: frames, messages, requests, and presence.

Only this package uses Zenoh; its exceptions are converted to BusError. Callbacks run on threads of the
session. They must return quickly and must not fetch or send requests.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack

import zenoh
from zenoh import handlers

from gepf.common.closing import Closing
from gepf.common.transport.channels import ANSWER_S, IncomingRequest, Publisher, RequestSender, mapped


class Bus(Closing):
    """One session on the bus. Closing it ends all its declarations, and then closes what it stands on."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._beneath = ExitStack()
        self._declared: list[object] = []  # declarations end when they are garbage collected

    @property
    def identity(self) -> str:
        """The identity of the session on the bus, in hexadecimal digits."""
        return str(self._session.info.zid())

    def close(self) -> None:
        """End the session; otherwise the interpreter cannot exit."""
        with self._beneath, mapped("closing the session"):
            self._session.close()  # type: ignore[no-untyped-call]

    def stand_on(self, beneath: ExitStack) -> Bus:
        """Close `beneath` after the session; returns this bus."""
        self._beneath = beneath
        return self

    def publish(self, key: str) -> Publisher:
        """A publisher of messages for all present subscribers."""
        with mapped(f"publishing on {key}"):
            return Publisher(self._session, self._session.declare_publisher(key))

    def subscribe(self, key: str, on_message: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Call `on_message(key, payload)` for every message published from now on.

        The returned function ends the subscription; it must not be called on a thread of the session.
        """

        def receive(sample: zenoh.Sample) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        with mapped(f"subscribing to {key}"):
            subscriber = self._session.declare_subscriber(key, receive)
        self._declared.append(subscriber)

        def end() -> None:
            self._declared.remove(subscriber)
            with mapped(f"ending the subscription to {key}"):
                subscriber.undeclare()  # type: ignore[no-untyped-call]

        return end

    def subscribe_newest(self, key: str, count: int) -> Callable[[], list[tuple[str, bytes]]]:
        """Keep the newest messages, up to a count; the returned function takes all of them, with their keys.

        Receiving them runs no Python code, so a slow program does not delay the sender.
        """
        with mapped(f"subscribing to {key}"):
            subscriber = self._session.declare_subscriber(key, handlers.RingChannel(count))
        self._declared.append(subscriber)

        def take() -> list[tuple[str, bytes]]:
            with mapped(f"receiving {key}"):
                samples = iter(subscriber.try_recv, None)
                return [(str(sample.key_expr), sample.payload.to_bytes()) for sample in samples]

        return take

    def serve(self, key: str, find: Callable[[str], bytes | None]) -> None:
        """Answer every fetch of a key with `find(key)`; None gives no answer."""

        def answer(query: zenoh.Query) -> None:
            with query:
                payload = find(str(query.key_expr))
                if payload is not None:
                    query.reply(query.key_expr, payload)

        with mapped(f"serving {key}"):
            self._declared.append(self._session.declare_queryable(key, answer))

    def fetch(self, key: str, timeout: float = ANSWER_S) -> bytes | None:
        """Fetch the value of a key; None without an answer within the timeout (seconds)."""
        with mapped(f"fetching {key}"):
            replies = self._session.get(
                key, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE, target=zenoh.QueryTarget.ALL
            )
            payloads = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
            return payloads[0] if payloads else None

    def serve_requests(self, key: str, on_request: Callable[[IncomingRequest], None]) -> None:
        """Call `on_request(request)` for every request on a key, which may have wildcards."""

        def receive(query: zenoh.Query) -> None:
            on_request(IncomingRequest(query))

        callback = handlers.Callback(receive, drop=lambda: None, indirect=False)
        with mapped(f"serving {key}"):
            self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def request_sender(self, key: str, timeout: float) -> RequestSender:
        """A sender of requests to the worker of a key; each ends within the timeout (seconds)."""
        with mapped(f"declaring requests to {key}"):
            return RequestSender(
                self._session.declare_querier(
                    key,
                    target=zenoh.QueryTarget.ALL,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=timeout,
                )
            )

    def announce(self, key: str) -> None:
        """Declare a liveliness token with this key until the session ends."""
        with mapped(f"announcing {key}"):
            self._declared.append(self._session.liveliness().declare_token(key))

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change(key, alive)` for all present tokens, and when one appears or disappears."""

        def change(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        with mapped(f"watching {key}"):
            self._declared.append(self._session.liveliness().declare_subscriber(key, change, history=True))

    def watch_links(self, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change(endpoint, linked)` for all present links, and when one is opened or closed."""

        def change(event: zenoh.LinkEvent) -> None:
            on_change(str(event.link.dst), event.kind == zenoh.SampleKind.PUT)

        with mapped("watching links"):
            self._declared.append(self._session.info.declare_link_events_listener(change, history=True))

    def meets_coordinator(self) -> bool:
        """Whether a link leads to a coordinator, and not only to routers."""
        with mapped("looking at links"):
            return any(there.whatami == zenoh.WhatAmI.PEER for there in self._session.info.transports())

    def is_linked(self, within: float = 0.0) -> bool:
        """Whether there is a connection, or one is opened within a time (seconds)."""
        deadline = time.monotonic() + within
        with mapped("looking at links"):
            while not self._session.info.transports():
                if time.monotonic() >= deadline:
                    return False
                time.sleep(0.02)
        return True
