"""What is wrong with a command line, and what there is to choose from."""

from __future__ import annotations

import typer


def describe_misuse(error: typer.TyperException) -> str:
    """The fault in one line; with what the missing thing is, or the commands that there are."""
    fault = error.format_message().rstrip(".")
    parameter, context = getattr(error, "param", None), getattr(error, "ctx", None)
    if parameter is not None and parameter.help:
        metavar = "" if parameter.metavar in (None, *fault.split("'")) else f" {parameter.metavar}"
        return f"{fault}{metavar}: {parameter.help}"
    commands = getattr(context.command, "commands", {}) if context is not None else {}
    return f"{fault}; there are {', '.join(commands)}" if commands and "?" not in fault else fault
