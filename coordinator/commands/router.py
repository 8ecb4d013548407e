"""A router of our own: where coordinators and workers meet that do not know each other's hosts."""

from __future__ import annotations

import signal
from collections.abc import Callable

from common.transport.bus import open_router
from common.transport.session import Security


def route(listen: str, connect: str | None, security: Security | None, tell: Callable[[str], None]) -> None:
    """Route until SIGTERM or SIGINT."""
    stop = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    with open_router([listen], [connect] if connect else [], security):
        tell(f"routing on {listen}")
        signal.sigwait(stop)
