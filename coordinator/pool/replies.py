"""What a worker's messages mean for the scheduler."""

from __future__ import annotations

from dataclasses import dataclass

from common.errors import ProtocolError, VersionError
from common.protocol.messages import decode_refusal
from coordinator.pool.dispatch.events import Ended, Event, Refused, Unavailable


@dataclass(frozen=True, slots=True)
class Reply:
    """A request has been answered; from a thread of the bus."""

    ticket: int
    payload: bytes
    at: float  # when, by the monotonic clock


def read_refusal(ticket: int, payload: bytes) -> Event:
    """A worker's reason, or the end of a request of which the bus itself knows no more."""
    try:
        refusal = decode_refusal(payload)
    except VersionError as error:
        return Refused(ticket, f"{error}; install the same gepf on both sides")
    except ProtocolError:
        return Ended(ticket)
    return (Unavailable if refusal.retryable else Refused)(ticket, refusal.reason)
