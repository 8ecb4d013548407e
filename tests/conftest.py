"""How the tests run: examples are the same every time, and the first call of a kernel may compile it.

Libraries of linear algebra stay on one core, as in workers: several tests run at once, and threads that wait
for each other would take what all others need.

A shell that starts the tests in the background has them ignore Ctrl-C, and all that they start, though some
end processes by it: so it is given back.
"""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded
os.environ.pop("GEPF_DEBUG", None)  # errors are one line, whatever the developer's own settings

settings.register_profile("gepf", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("gepf")

signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def endpoint() -> Iterator[str]:
    """A place for sessions of this process to meet; its path is short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="gepf-test-") as folder:
        yield f"unixsock-stream/{Path(folder) / 'bus'}"
