"""What goes on beside a test's body."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def in_thread(act: Callable[[threading.Event], None]) -> Iterator[None]:
    """Something that goes on beside the body until it is stopped."""
    stop = threading.Event()
    thread = threading.Thread(target=act, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(60.0)
