"""`gepf certificates`: certificates for a trial."""

from __future__ import annotations

from collections.abc import Callable

from coordinator.commands.options.arguments import CertificateOptions
from coordinator.commands.options.choices import at_least
from coordinator.security.access import choose_names
from coordinator.security.certificates import make_certificates


def run_certificates(options: CertificateOptions, say: Callable[[str], None]) -> None:
    """Make what is missing in the folder, and report what that was."""
    at_least(1, "--days", options.days)
    hosts = tuple(host.strip() for host in options.hosts.split(",") if host.strip())
    names = choose_names(options.workers)
    new = make_certificates(options.out, names, hosts, options.days, options.mount)
    made = ", ".join(new) or "nothing, all are there and good"
    say(f"new in {options.out}: {made}; keep ca.key to yourself")
