"""`gepf.toml`: options of any command, one table per command; the command line has priority."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer.core import TyperGroup

from common.errors import InputError

if TYPE_CHECKING:
    from typer import Context

CONFIG_FILE = Path("gepf.toml")

Command = Any
"""A command of typer, whose base class has no public name."""


def use_config(context: Context, given: Path | None) -> None:
    """Make the options of a file the defaults of all commands below `context`.

    The file is `given`, else `gepf.toml` in the working folder, if there is one. Raises InputError for an
    unreadable file, and for unknown names.
    """
    file = given or CONFIG_FILE
    if given is None and not file.is_file():
        return
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give another --config") from error
    except ValueError as error:
        raise InputError(f"{file} is not valid TOML: {error}; see https://toml.io") from error
    context.default_map = defaults_of(context.command, table, str(file))


def defaults_of(command: Command, table: Mapping[str, Any], place: str) -> dict[str, Any]:
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
