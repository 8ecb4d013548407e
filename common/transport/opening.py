"""Sessions on the bus, as coordinator, worker and router open them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

import zenoh

from common.errors import BusError, InputError
from common.transport.bus import Bus
from common.transport.channels import ANSWER_S, bus_error
from common.transport.endpoints import why_refused
from common.transport.session import Security, session_settings

UNREACHABLE = "Unable to connect"  # how Zenoh begins when it could not reach any endpoint in time


def open_coordinator(
    listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None
) -> Bus:
    """A session that workers connect to, and that itself connects to routers.

    InputError if a router refuses us; one that is not there yet is tried in the background.
    """
    return open_linked("peer", listen, connect, security)


def open_linked(mode: str, listen: Sequence[str], connect: Sequence[str], security: Security | None) -> Bus:
    """A session with links to all its endpoints. InputError if one refuses us before any lets us in."""
    bus = open_session(session_settings(mode, listen, connect, security))
    if connect and not bus.is_linked(within=ANSWER_S):
        try:
            check_refusals(connect, security)
        except InputError:
            bus.close()
            raise
    return bus


def open_worker(
    connect: Sequence[str],
    security: Security | None = None,
    on_silence: Callable[[float], None] = lambda _: None,
) -> Bus:
    """A session of a worker, which tries to connect for ever, unless it is refused; that is an InputError.

    `on_silence` is called after each attempt that nobody answered, with the seconds since the first began;
    what it raises ends the attempts. While one lasts, Python handles no signals. A session with several
    endpoints is on all of them as they come, and here returns when the first has answered.
    """
    began = time.monotonic()
    if len(connect) > 1:  # a client would be on one of them only
        bus = open_linked("peer", (), connect, security)
        try:
            while not bus.is_linked(within=ANSWER_S):
                on_silence(time.monotonic() - began)
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
        on_silence(time.monotonic() - began)


def open_router(listen: Sequence[str], connect: Sequence[str] = (), security: Security | None = None) -> Bus:
    """A session that coordinators and workers meet at. InputError if a router that it joins refuses us."""
    return open_linked("router", listen, connect, security)


def check_refusals(connect: Sequence[str], security: Security | None) -> None:
    """InputError if somebody listens at an endpoint and refuses us."""
    for endpoint in connect:
        reason = why_refused(endpoint, None if security is None else security.credentials)
        if reason is not None:
            raise InputError(reason)


def open_session(settings: dict[str, Any]) -> Bus:
    """A session as the settings say."""
    listen, connect = (settings[side]["endpoints"] for side in ("listen", "connect"))
    try:
        return Bus(zenoh.open(zenoh.Config.from_json5(json.dumps(settings))))
    except zenoh.ZError as error:
        if "Address already in use" in str(error):
            taken = [endpoint for endpoint in listen if f"{endpoint}:" in str(error)] or listen
            message = f"{taken[0]} is in use by another program; end that, or choose another port"
            raise InputError(message) from error
        raise bus_error("opening " + ", ".join([*listen, *connect]), error) from error
