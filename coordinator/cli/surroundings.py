"""What commands have around them: the screen, and who refines."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from coordinator.commands.console.progress import Show
    from coordinator.commands.workers import Connect


def say(message: str) -> None:
    """Write one line to stderr."""
    sys.stderr.write(f"gepf: {' '.join(message.split())}\n")


def on_stderr(*, quiet: bool = False) -> Show:
    """Progress for people, unless they want none."""
    from rich.console import Console

    from coordinator.commands.console.progress import show_on

    return show_on(Console(stderr=True, quiet=quiet))


def connect_of(context: typer.Context) -> Connect[Any]:
    """How a command reaches workers: as `main` was given, else over the bus."""
    from coordinator.commands import workers

    return context.obj or workers.connect_workers
