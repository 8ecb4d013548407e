"""`gepf router`: where coordinators and workers meet that do not know each other's hosts."""

from __future__ import annotations

import signal
from collections.abc import Callable

from common.transport.opening import open_router
from common.transport.session import ROUTER
from coordinator.commands.options.arguments import RouterOptions, SecurityOptions
from coordinator.commands.options.choices import secure


def run_router(options: RouterOptions, security: SecurityOptions, say: Callable[[str], None]) -> None:
    """Route until SIGTERM or SIGINT."""
    secured = secure(security, options.listen, options.connect, holder=ROUTER)
    stop = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    with open_router([options.listen], [options.connect] if options.connect else [], secured):
        say(f"routing on {options.listen}")
        signal.sigwait(stop)
