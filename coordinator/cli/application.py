"""The command line as a whole: the file with options, exit codes, and messages for wrong command lines."""

from __future__ import annotations

import logging
import os
import tomllib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from gepf.common.errors import InputError
from gepf.common.packages import needs
from gepf.coordinator.cli.commands import app
from gepf.coordinator.commands.console import DEBUG, ExitCode, exit_code


def use_config(context: typer.Context, given: Path | None) -> None:
    """Make the options of a file the defaults of all commands below `context`.

    The file is `given`, else `gepf.toml` in the working folder, if there is one. Raises InputError for an
    unreadable file, and for unknown names. A file that the user did not name cannot turn encryption off:
    somebody else may have put it into the folder.
    """
    file = given or Path("gepf.toml")
    if given is None and not file.is_file():
        return
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give another --config") from error
    except ValueError as error:
        raise InputError(f"{file} is not valid TOML: {error}; see https://toml.io") from error
    context.default_map = defaults_of(context.command, table, str(file))
    for command, values in context.default_map.items():
        if given is None and values.get("insecure"):
            raise InputError(
                f"{file}: [{command}]: insecure is for the command line (--insecure), or for a file that "
                "--config names; remove it here"
            )


def defaults_of(command: Any, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Values by parameter, nested like the commands. `place` is the position of the table."""
    nested = isinstance(command, TyperGroup)
    options = [each for each in command.params if each.param_type_name == "option"]
    known = command.commands if nested else {each.opts[0].removeprefix("--"): each for each in options}
    found: dict[str, Any] = {}
    for written, value in table.items():
        name = written.replace("_", "-")
        if name not in known or isinstance(value, dict) != nested:
            what = "command" if nested else "option"
            close = get_close_matches(name, known, n=1)
            mend = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(known)) or 'none'}"
            raise InputError(f"{place}: there is no {what} '{written}'; {mend}")
        if isinstance(value, dict):
            found[name] = defaults_of(known[name], value, f"{place}: [{name}]")
        else:
            found[known[name].name] = value
    return found


if TYPE_CHECKING:
    from gepf.coordinator.pool.zenoh_refiner import Connect

EXAMPLES = """A first run:

gepf info recording/

gepf track recording/ --out run/

gepf report run/

Options that are always the same can be set in gepf.toml, in a table for each command.
"""


def main(arguments: Sequence[str] | None = None, connect: Connect | None = None) -> int:
    """Run a command line and return its exit code. `connect` opens a pool in place of the usual one."""
    logging.basicConfig(format="gepf: %(message)s", level=logging.WARNING)

    def work() -> int:
        try:
            with needs("coordinator", "this command"):
                code = app(arguments, prog_name="gepf", standalone_mode=False, obj=connect)
        except typer.TyperException as error:
            raise InputError(describe_misuse(error)) from error
        if code == ExitCode.INTERRUPTED:  # typer turns a KeyboardInterrupt into this code
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0

    return exit_code(work, "gepf")


def describe_misuse(error: typer.TyperException) -> str:
    """The error in one line, with a description of what is missing, or the list of commands."""
    fault = error.format_message().rstrip(".")
    if (cause := error.__cause__) is not None and hasattr(cause, "errors"):  # of a number, by pydantic
        fault = fault.partition(", unable")[0].replace("Input", f"'{cause.errors()[0]['input']}'")
    parameter, context = getattr(error, "param", None), getattr(error, "ctx", None)
    if parameter is not None and parameter.help:
        metavar = f" {parameter.metavar}" if fault.startswith("Missing option") else ""
        return f"{fault}{metavar}: {parameter.help}"
    commands = getattr(context.command, "commands", {}) if context is not None else {}
    return f"{fault}; there are {', '.join(commands)}" if commands and "?" not in fault else fault


@app.callback(invoke_without_command=True, epilog=EXAMPLES)
def gepf(
    context: typer.Context,
    *,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File with options (default: gepf.toml in the working folder)."),
    ] = None,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error, as GEPF_DEBUG=1 does.")
    ] = False,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Track a body through depth images with many pose hypotheses.

    `gepf demo` tracks a rendered example; `gepf track SEQ --out DIR` tracks your recording.
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
