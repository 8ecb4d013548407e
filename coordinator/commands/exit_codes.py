"""What the program ends with."""

from __future__ import annotations

import signal

DONE, FAILED, INPUT_AT_FAULT, INTERRUPTED = 0, 1, 2, 128 + signal.SIGINT
NOT_TRACKED = 3  # done, but most frames were not
