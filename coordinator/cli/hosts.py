"""The commands for many hosts: publish, certificates and router."""

from __future__ import annotations

import typer

from coordinator.cli.surroundings import on_stderr, say
from coordinator.commands.options.arguments import (
    CertificateOptions,
    PublishOptions,
    Quiet,
    RouterOptions,
    SecurityOptions,
)
from coordinator.commands.options.grouped import grouped

PANEL = "Many hosts"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
@grouped
def publish(options: PublishOptions, security: SecurityOptions, quiet: Quiet = False) -> None:
    """Publish a recorded sequence in real time, as a camera would: input for gepf track zenoh:KEY."""
    from coordinator.commands.publish import run_publish

    run_publish(options, security, on_stderr(quiet=quiet))


@app.command(rich_help_panel=PANEL)
@grouped
def certificates(options: CertificateOptions) -> None:
    """Make certificates for a trial: an authority, coordinator, router and workers."""
    from coordinator.commands.certificates import run_certificates

    run_certificates(options, say)


@app.command(rich_help_panel=PANEL)
@grouped
def router(options: RouterOptions, security: SecurityOptions) -> None:
    """Let coordinators and workers meet, until stopped."""
    from coordinator.commands.router import run_router

    run_router(options, security, say)
