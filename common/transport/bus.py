"""The bus. This is the only file that knows Zenoh; what Zenoh raises leaves here as BusError.

Callbacks run on threads of the session. They must return soon and must not fetch or ask.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh import ext, handlers

from common.errors import BusError, InputError
from common.transport.session import Security, session_settings
from common.transport.tls_probe import why_refused

ATTEMPT_MS = 2_000  # to connect, until we ask why we are not let in
WAITING_REQUESTS = 64  # at one worker; the oldest is dropped, and so sent elsewhere
SIGNALS_S = 0.2  # between looks for a signal that came just before a wait, which it would not end
FRAMES_KEPT = 2  # for late joiners
HEARTBEAT_S = 0.5
UNREACHABLE = "Unable to connect"  # how Zenoh begins when it could not reach any endpoint in time

Payload = Callable[[bytes], None]


def ignore(_: float) -> None:
    """Do nothing about silence."""


class Bus:
    """One session. Everything that is declared on it ends with it."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[object] = []  # what ends when it is forgotten

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session; the interpreter could not exit otherwise."""
        with mapped("closing the session"):
            self._session.close()  # type: ignore[no-untyped-call]

    def publish_frames(self, key: str) -> FramePublisher:
        """Publisher whose last samples are kept for those who join late."""
        with mapped(f"publishing on {key}"):
            return FramePublisher(
                ext.declare_advanced_publisher(
                    self._session,
                    key,
                    congestion_control=zenoh.CongestionControl.DROP,
                    cache=ext.CacheConfig(max_samples=FRAMES_KEPT),
                    sample_miss_detection=ext.MissDetectionConfig(
                        heartbeat=None, sporadic_heartbeat=HEARTBEAT_S
                    ),
                    publisher_detection=True,
                )
            )

    def follow_frames(self, key: str, on_frame: Callable[[str, int, bytes], None]) -> None:
        """Have `on_frame(key, number, payload)` called for every frame, and for the last one before now."""

        def receive(sample: zenoh.Sample) -> None:
            number = number_of(sample.attachment)
            if number is not None:
                on_frame(str(sample.key_expr), number, sample.payload.to_bytes())

        with mapped(f"subscribing to {key}"):
            self._declared.append(
                ext.declare_advanced_subscriber(
                    self._session,
                    key,
                    receive,
                    history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                    recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
            )

    def publish(self, key: str) -> Publisher:
        """Publisher of messages for whoever listens now."""
        with mapped(f"publishing on {key}"):
            return Publisher(self._session, self._session.declare_publisher(key))

    def subscribe(self, key: str, on_message: Payload) -> None:
        """Have `on_message(payload)` called for every message that is published from now on."""

        def receive(sample: zenoh.Sample) -> None:
            on_message(sample.payload.to_bytes())

        with mapped(f"subscribing to {key}"):
            self._declared.append(self._session.declare_subscriber(key, receive))

    def serve(self, key: str, find: Callable[[str], bytes | None]) -> None:
        """Answer every fetch of a key with `find(key)`; None leaves it without an answer."""

        def answer(query: zenoh.Query) -> None:
            with query:
                payload = find(str(query.key_expr))
                if payload is not None:
                    query.reply(query.key_expr, payload)

        with mapped(f"serving {key}"):
            self._declared.append(self._session.declare_queryable(key, answer))

    def fetch(self, key: str, timeout: float) -> bytes | None:
        """What is served under a key, or None if nobody answers within the timeout (seconds)."""
        with mapped(f"fetching {key}"):
            replies = self._session.get(
                key, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE, target=zenoh.QueryTarget.ALL
            )
            found = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
            return found[0] if found else None

    def requests(self, key: str) -> Requests:
        """Requests to this worker, one after the other."""
        arrivals = Arrivals()
        callback = handlers.Callback(arrivals.put, drop=arrivals.end, indirect=False)
        with mapped(f"serving {key}"):
            return Requests(self._session.declare_queryable(key, callback, complete=True), arrivals)

    def asker(self, key: str, timeout: float) -> Asker:
        """Sends requests to the worker that serves a key; each ends within the timeout (seconds)."""
        with mapped(f"asking {key}"):
            return Asker(
                self._session.declare_querier(
                    key,
                    target=zenoh.QueryTarget.ALL,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=timeout,
                )
            )

    def announce(self, key: str) -> None:
        """Declare this session alive under a key, for as long as it lives."""
        with mapped(f"announcing {key}"):
            self._declared.append(self._session.liveliness().declare_token(key))

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Have `on_change(key, alive)` called for all who are announced, and when one comes or goes."""

        def change(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        with mapped(f"watching {key}"):
            self._declared.append(self._session.liveliness().declare_subscriber(key, change, history=True))

    def watch_links(self, on_change: Callable[[str, bool], None]) -> None:
        """Have `on_change(endpoint, linked)` called for all links to others, and when one comes or goes."""

        def change(event: zenoh.LinkEvent) -> None:
            on_change(str(event.link.dst), event.kind == zenoh.SampleKind.PUT)

        with mapped("watching links"):
            self._declared.append(self._session.info.declare_link_events_listener(change, history=True))

    def is_linked(self, within: float) -> bool:
        """Whether anybody is connected, or comes to be within a time (seconds)."""
        deadline = time.monotonic() + within
        with mapped("looking at links"):
            links = self._session.info.declare_link_events_listener(history=True)
            while time.monotonic() < deadline:
                if links.try_recv() is not None:
                    return True
                time.sleep(0.02)
        return False


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


class Requests:
    """What a worker is asked for, oldest first."""

    def __init__(self, queryable: zenoh.Queryable[None], arrivals: Arrivals) -> None:
        self._queryable = queryable
        self._arrivals = arrivals

    def receive(self, *, wait: bool) -> list[Request] | None:
        """What has come; if that is nothing and `wait`, what comes within a while. None after the end."""
        queries = self._arrivals.take(wait=wait)
        return None if queries is None else [Request(query) for query in queries]

    def wake(self) -> None:
        """Have `receive` return; may be called from another thread."""
        self._arrivals.wake()

    def close(self) -> None:
        """No more requests; may be called from another thread."""
        self._arrivals.end()
        with mapped("closing the queryable"):
            self._queryable.undeclare()  # type: ignore[no-untyped-call]


class Arrivals:
    """Queries between a thread of the bus, which puts them, and the worker's, which takes them."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[zenoh.Query | None] = SimpleQueue()  # None to wake who waits
        self._ended = False

    def put(self, query: zenoh.Query) -> None:
        """A query has come; the oldest ends if too many wait."""
        if self._waiting.qsize() >= WAITING_REQUESTS:
            with suppress(Empty):
                oldest = self._waiting.get_nowait()
                if oldest is not None:
                    oldest.drop()  # type: ignore[no-untyped-call]
        self._waiting.put(query)

    def take(self, *, wait: bool) -> list[zenoh.Query] | None:
        """All that wait; if that is none and `wait`, the first to come in a while. None after the end."""
        taken = []
        with suppress(Empty):
            taken.append(self._waiting.get(block=wait, timeout=SIGNALS_S))
            while len(taken) < WAITING_REQUESTS:
                taken.append(self._waiting.get_nowait())
        return None if self._ended else [query for query in taken if query is not None]

    def wake(self) -> None:
        """Let who waits go on; nobody waits where there is something to take."""
        if self._waiting.empty():
            self._waiting.put(None)

    def end(self) -> None:
        """No more queries will come."""
        self._ended = True
        self.wake()


class Request:
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


class Asker:
    """Asks one worker."""

    def __init__(self, querier: zenoh.Querier) -> None:
        self._querier = querier

    def ask(self, payload: bytes, on_reply: Payload, on_refusal: Payload, on_end: Callable[[], None]) -> None:
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
            raise bus_error("asking a worker", error) from error

    def close(self) -> None:
        """No more requests."""
        with mapped("closing a querier"):
            self._querier.undeclare()  # type: ignore[no-untyped-call]


def open_coordinator(
    listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None
) -> Bus:
    """A session that workers connect to, and that itself connects to routers.

    InputError if a router refuses us; one that is not there yet is tried in the background.
    """
    return open_peer(listen, connect, security, shared_pool_bytes=4 * 2**20)


def open_peer(
    listen: Sequence[str], connect: Sequence[str], security: Security | None, shared_pool_bytes: int
) -> Bus:
    """A session with links to all its endpoints. InputError if one refuses us before any lets us in."""
    bus = open_session(session_settings("peer", listen, connect, security), shared_pool_bytes)
    if connect and not bus.is_linked(within=ATTEMPT_MS / 1000):
        try:
            check_refusals(connect, security)
        except InputError:
            bus.close()
            raise
    return bus


def open_worker(
    connect: Sequence[str], security: Security | None = None, on_silence: Callable[[float], None] = ignore
) -> Bus:
    """A session of a worker, which tries to connect for ever, unless it is refused; that is an InputError.

    `on_silence` is called after each attempt that nobody answered, with the seconds since the first began;
    what it raises ends the attempts. While one lasts, 2 s, Python handles no signals. With several endpoints
    the session is on all of them as they come.
    """
    if len(connect) > 1:  # a client would be on one of them only
        return open_peer((), connect, security, shared_pool_bytes=2**20)
    settings = session_settings("client", (), connect, security)
    settings["connect"] |= {"timeout_ms": ATTEMPT_MS, "exit_on_failure": True}
    began = time.monotonic()
    while True:
        try:
            return open_session(settings, shared_pool_bytes=2**20)
        except BusError as error:
            if UNREACHABLE not in str(error):
                raise
        check_refusals(connect, security)
        on_silence(time.monotonic() - began)


def open_router(listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None) -> Bus:
    """A session that coordinators and workers meet at."""
    return open_session(session_settings("router", listen, connect, security), shared_pool_bytes=2**20)


def check_refusals(connect: Sequence[str], security: Security | None) -> None:
    """InputError if somebody listens at an endpoint and refuses us."""
    for endpoint in connect:
        reason = why_refused(endpoint, None if security is None else security.credentials)
        if reason is not None:
            raise InputError(reason)


def open_session(settings: dict[str, Any], shared_pool_bytes: int) -> Bus:
    """A session as the settings say, with shared memory towards programs of this host."""
    # For frames only: replies by shared memory are never given back.
    shared = {"transport_optimization": {"pool_size": shared_pool_bytes, "messages": ["put"]}}
    transport = settings["transport"] | {"shared_memory": shared}
    config = json.dumps(settings | {"transport": transport})
    endpoints = [*settings["listen"]["endpoints"], *settings["connect"]["endpoints"]]
    with mapped("opening " + ", ".join(endpoints)):
        return Bus(zenoh.open(zenoh.Config.from_json5(config)))


def number_of(attachment: zenoh.ZBytes | None) -> int | None:
    """A frame's number from its attachment; None where that is no number."""
    text = b"" if attachment is None else attachment.to_bytes()
    return int(text) if re.fullmatch(rb"[0-9]{1,15}", text) else None


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
