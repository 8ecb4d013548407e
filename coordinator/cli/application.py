"""The command `gepf`.

What another program would read goes to stdout, all else to stderr. Exit codes: 0 done, 2 the user's input
is at fault (one line on stderr), 3 done, but most frames were not tracked, 130 interrupted, 1 anything
else. What takes long to load is imported by the command that needs it.
"""

from __future__ import annotations

import errno
import logging
import os
import signal
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import GepfError, InputError
from coordinator.cli.commands import app as commands
from coordinator.cli.commands import say
from coordinator.cli.config_file import use_config
from coordinator.commands.console import (
    DONE,
    FAILED,
    INPUT_AT_FAULT,
    INTERRUPTED,
    INTERRUPTS,
    noted_interrupts,
)

if TYPE_CHECKING:
    from coordinator.commands.workers import Connect

DEBUG = "GEPF_DEBUG"

EXAMPLES = """A first run:

gepf info recording/

gepf track recording/ --out run/

gepf report run/

Options that are always the same can stand in gepf.toml, in a table for each command.
"""

app = typer.Typer(epilog=EXAMPLES)

app.add_typer(commands)


def main(arguments: Sequence[str] | None = None, connect: Connect | None = None) -> int:
    """Run a command line and return its exit code. `connect` opens another pool than that of workers."""
    logging.basicConfig(format="gepf: %(message)s", level=logging.WARNING)
    try:
        with noted_interrupts(signal.SIGINT):
            code = app(arguments, prog_name="gepf", standalone_mode=False, obj=connect)
    except KeyboardInterrupt as interrupt:
        INTERRUPTS.forget()
        if isinstance(interrupt.__cause__, GepfError):  # results that could not be kept, say
            complain(interrupt.__cause__, INTERRUPTED)
        code = INTERRUPTED
    except InputError as error:
        return complain(error, INPUT_AT_FAULT)
    except typer.TyperException as error:
        return complain(error, error.exit_code, describe_misuse(error))
    except GepfError as error:
        return complain(error, FAILED)
    except ModuleNotFoundError as error:
        mend = f"the package {error.name} is missing; pip install 'gepf[coordinator]'"
        return complain(error, FAILED, mend)
    except Exception as error:  # noqa: BLE001 whatever it is, a user reads one line
        return complain(error, FAILED, describe_fault(error))
    if code == INTERRUPTED:
        say("stopped")
    return code if isinstance(code, int) else DONE


def describe_misuse(error: typer.TyperException) -> str:
    """The fault in one line; with what the missing thing is, or the commands that there are."""
    fault = error.format_message().rstrip(".")
    parameter, context = getattr(error, "param", None), getattr(error, "ctx", None)
    if parameter is not None and parameter.help:
        metavar = "" if parameter.metavar in (None, *fault.split("'")) else f" {parameter.metavar}"
        return f"{fault}{metavar}: {parameter.help}"
    commands = getattr(context.command, "commands", {}) if context is not None else {}
    return f"{fault}; there are {', '.join(commands)}" if commands and "?" not in fault else fault


def describe_fault(error: Exception) -> str:
    """A fault that was not foreseen; where the disk is full, what to do then."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = f" for {error.filename}" if error.filename else ""
        return f"no space is left on the disk{where}; make room; gepf track --resume goes on with a run"
    return f"{type(error).__name__}: {error} (gepf --debug shows where)"


def complain(error: Exception, code: int, message: str | None = None) -> int:
    """Report an error in one line, after its trace if debugging, and return the exit code."""
    if os.environ.get(DEBUG, "0") != "0":
        traceback.print_exception(error)
    say(str(error) if message is None else message)
    return code


@app.callback(invoke_without_command=True)
def gepf(
    context: typer.Context,
    *,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Options of the commands (default: gepf.toml, if it is here)."),
    ] = None,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show where an error arose; so does GEPF_DEBUG=1.")
    ] = False,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Track a body through depth images, following many pose hypotheses at once.

    `gepf demo` shows what it does; `gepf track SEQ --out DIR` does it with your recording.
    """
    if debug:
        os.environ[DEBUG] = "1"
    if version:
        from importlib import metadata

        typer.echo(f"gepf {metadata.version('gepf')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
    else:
        use_config(context, config)
