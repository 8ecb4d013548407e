"""Opens the sessions of coordinator, worker and router."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

import zenoh

from gepf.common.errors import BusError, InputError
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import ANSWER_S, bus_error
from gepf.common.transport.endpoints import ENCRYPTED, LOCAL, protocol_of, why_refused
from gepf.common.transport.renewal import Front
from gepf.common.transport.session import Security, session_settings

UNREACHABLE = "Unable to connect"  # start of Zenoh's message if no endpoint answers


def open_coordinator(
    listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None
) -> Bus:
    """A session to which workers connect, and which connects to routers. Its certificate may be renewed.

    InputError if an endpoint cannot be opened, or a router refuses the connection; a router that does not
    answer is tried in the background.
    """
    return open_listening("peer", listen, connect, security)


def open_listening(
    mode: str, listen: Sequence[str], connect: Sequence[str], security: Security | None
) -> Bus:
    """A session with links to all its endpoints; behind a router if it listens with a certificate."""
    if security is None or not any(protocol_of(endpoint) == ENCRYPTED for endpoint in listen):
        return open_linked(mode, listen, connect, security)
    with ExitStack() as stack:
        behind = f"{LOCAL}/{stack.enter_context(private_folder())}/front"
        reopen = partial(open_linked, "router", [behind, *listen], connect, security)
        stack.enter_context(Front(reopen, security.credentials))
        bus = open_session(session_settings("client", (), [behind]))
        return bus.stand_on(stack.pop_all())


def open_linked(mode: str, listen: Sequence[str], connect: Sequence[str], security: Security | None) -> Bus:
    """A session with links to all its endpoints. InputError if one refuses before any link is open."""
    bus = open_session(session_settings(mode, listen, connect, security))
    if connect and not bus.is_linked(within=ANSWER_S):
        try:
            check_refusals(connect, security)
        except InputError:
            bus.close()
            raise
    return bus


def open_worker(
    connect: Sequence[str], security: Security | None = None, on_silence: Callable[[], None] = lambda: None
) -> Bus:
    """A session of a worker, which tries to connect for ever; InputError if it is refused.

    `on_silence` is called after each attempt without an answer; its exceptions end the attempts. During an
    attempt Python handles no signals. With several endpoints this returns when the first has answered; the
    others are added when they answer.
    """
    if len(connect) > 1:  # a client connects to only one of them
        bus = open_linked("peer", (), connect, security)
        try:
            while not bus.is_linked(within=ANSWER_S):
                on_silence()
        except BaseException:
            bus.close()
            raise
        return bus
    settings = session_settings("client", (), connect, security)
    settings["connect"] |= {"timeout_ms": int(1000 * ANSWER_S), "exit_on_failure": True}
    while True:
        try:
            return open_session(settings)
        except BusError as error:
            if UNREACHABLE not in str(error):
                raise
        check_refusals(connect, security)
        on_silence()


def open_router(listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None) -> Bus:
    """The session of a router. InputError if another router refuses the connection.

    Its certificate may be renewed.
    """
    return open_listening("router", listen, connect, security)


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A private folder whose path is short enough for a socket."""
    usual = len(tempfile.gettempdir()) <= 80  # the path of a socket has at most 107 characters
    return tempfile.TemporaryDirectory(prefix="gepf-", dir=None if usual else "/tmp")


def check_refusals(connect: Sequence[str], security: Security | None) -> None:
    """InputError if an endpoint refuses the connection."""
    for endpoint in connect:
        reason = why_refused(endpoint, None if security is None else security.credentials)
        if reason is not None:
            raise InputError(reason)


def open_session(settings: dict[str, Any]) -> Bus:
    """A session with these settings."""
    listen, connect = (settings[side]["endpoints"] for side in ("listen", "connect"))
    try:
        return Bus(zenoh.open(zenoh.Config.from_json5(json.dumps(settings))))
    except zenoh.ZError as error:
        if "Address already in use" in str(error):
            taken = [endpoint for endpoint in listen if f"{endpoint}:" in str(error)] or listen
            message = f"{taken[0]} is in use by another program; end it, or choose another port"
            raise InputError(message) from error
        failed = bus_error(f"cannot open {', '.join([*listen, *connect])}", error)
        if UNREACHABLE in str(error):
            raise failed from error
        raise InputError(f"{failed}; check the endpoint") from error
