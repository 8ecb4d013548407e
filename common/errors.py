"""All errors that gepf raises intentionally.

GepfError
├── InputError       wrong input from the user; the message says what is wrong and how to fix it (exit code 2)
│   └── MissingPackage  a package of an extra is not installed (common/packages.py)
├── ProtocolError    a message is invalid or cannot be served
│   └── VersionError it has another version of the protocol
└── BusError         the transport failed
    ├── NoWorkers    no worker joined within the timeout
    └── SilentWorkers  workers are connected, but none answers
"""

from __future__ import annotations

from collections.abc import Collection


class GepfError(Exception):
    """Base class of all errors."""


class InputError(GepfError):
    """Wrong input from the user. The message is one line: what is wrong, and how to fix it."""


class ProtocolError(GepfError):
    """A message is malformed, too large, of another version, or cannot be served."""


class VersionError(ProtocolError):
    """A message has another version of the protocol: the versions of gepf differ."""


class BusError(GepfError):
    """The transport failed: an endpoint cannot be opened, a session was lost."""


class NoWorkers(BusError):
    """There is no worker, and none joined within the timeout."""


class SilentWorkers(BusError):
    """Workers are connected, but none answers: the connection is broken, or all of them hang."""


def check_choice(what: str, chosen: str, known: Collection[str]) -> None:
    """InputError if the name is not a valid choice of this kind."""
    if chosen not in known:
        raise InputError(f"unknown {what} '{chosen}'; choose from {', '.join(known)}")
