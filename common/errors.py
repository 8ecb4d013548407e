"""Every error that gepf raises on purpose.

GepfError
├── InputError       the user's input is at fault; the message says what and how to mend it (exit code 2)
├── ProtocolError    a message on the wire makes no sense or cannot be served
│   └── VersionError it is of another version of the protocol
└── BusError         the transport failed
    ├── NoWorkers    nobody is there to refine particles, and the wait for one is over
    └── SilentWorkers  workers are there, and none of them answers
"""


class GepfError(Exception):
    """Root of all errors raised on purpose."""


class InputError(GepfError):
    """The user's input is at fault. The message is one line: what is wrong, and how to mend it."""


class ProtocolError(GepfError):
    """A message on the wire is malformed, too large, of another version, or cannot be served."""


class VersionError(ProtocolError):
    """A message is of another version of the protocol: gepf is not the same on both sides."""


class BusError(GepfError):
    """The transport failed: an endpoint cannot be opened, a session was lost."""


class NoWorkers(BusError):
    """No worker is alive, and none came within the time that was allowed."""


class SilentWorkers(BusError):
    """Workers are alive, and none of them answers: the way to them is broken, or all of them hang."""
