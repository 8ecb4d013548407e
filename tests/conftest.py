"""How the tests run: examples are the same every time, and the first call of a kernel may compile it.

A shell that starts the tests in the background has them ignore Ctrl-C, and all that they start, though some
end processes by it: so it is given back.
"""

from __future__ import annotations

import signal

from hypothesis import settings

settings.register_profile("gepf", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("gepf")

signal.signal(signal.SIGINT, signal.default_int_handler)
