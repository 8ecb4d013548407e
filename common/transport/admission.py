"""Whether the other side admits the name in a certificate: access control drops messages silently."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from gepf.common.transport.opening import open_worker
from gepf.common.transport.session import Security

SEEN_WITHIN_S = 5.0  # until a session sees the token of another


def is_seen(
    key: str, connect: Sequence[str], security: Security | None, on_silence: Callable[[], None] = lambda: None
) -> bool:
    """Whether a separate session sees a liveliness token soon; `on_silence` is that of `open_worker`."""
    seen = threading.Event()
    with open_worker(connect, security, on_silence) as mirror:
        mirror.watch(key, lambda _, alive: seen.set() if alive else None)
        return seen.wait(SEEN_WITHIN_S)
