"""Health check of a container: whether the worker is seen at its coordinator or router."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from common.errors import BusError
from common.protocol import keys
from common.transport.opening import open_worker
from common.transport.session import Security

PATIENCE = 3.0  # seconds


def check_alive(
    name: str, connect: Sequence[str], security: Security | None, patience: float = PATIENCE
) -> None:
    """Look for the worker's liveliness token; BusError if it is not there."""
    seen = threading.Event()
    with open_worker(connect, security) as bus:
        bus.watch(keys.worker_alive(name), lambda _, alive: seen.set() if alive else None)
        if not seen.wait(patience):
            raise BusError(f"worker '{name}' is not seen at {', '.join(connect)}")
