"""Whether the other side accepts a worker's name; access control drops messages silently."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from common.errors import InputError
from common.protocol import keys
from common.transport.bus import Bus
from common.transport.opening import open_worker
from common.transport.session import Security

PATIENCE = 5.0  # seconds


def check_admission(
    bus: Bus, name: str, connect: Sequence[str], security: Security, patience: float = PATIENCE
) -> None:
    """Announce the worker and look for it through a second session; InputError if it cannot be seen."""
    key = keys.worker_admission(name)
    seen = threading.Event()
    bus.announce(key)
    with open_worker(connect, security) as mirror:
        mirror.watch(key, lambda _, alive: seen.set() if alive else None)
        if not seen.wait(patience):
            raise InputError(
                f"{', '.join(connect)} does not let {security.credentials.cert} be worker '{name}'; "
                f"have '{name}' listed there in workers.txt, and give the certificate for that name"
            )
