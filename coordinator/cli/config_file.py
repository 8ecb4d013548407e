"""`gepf.toml`: options of any command, one table a command, for which the command line stays the master."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

import msgspec
from typer.core import TyperGroup

from common.errors import InputError

if TYPE_CHECKING:
    from typer import Context

CONFIG_FILE = Path("gepf.toml")

Command = Any
"""A command of typer, which gives its base class no public name."""


def use_config(context: Context, given: Path | None) -> None:
    """Make the options of a file the defaults of all commands below `context`.

    The file is `given`, else `gepf.toml` in the working folder, if there is one. Raises InputError for a file
    that cannot be read, for names that no command knows and for values of a wrong type.
    """
    if given is None and not CONFIG_FILE.is_file():
        return
    file = given or CONFIG_FILE
    context.default_map = defaults_of(context.command, read_toml(file), str(file))


def read_toml(file: Path) -> dict[str, Any]:
    """The content of a TOML file."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}; give another --config") from error
    except ValueError as error:
        raise InputError(f"{file} is no TOML: {error}; see https://toml.io") from error


def defaults_of(command: Command, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Values by the names of parameters, nested as the commands are. `place` is where the table stands."""
    return (
        group_defaults(command, table, place)
        if isinstance(command, TyperGroup)
        else command_defaults(command, table, place)
    )


def group_defaults(group: TyperGroup, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Defaults of commands by their names."""
    known = {name: f"[{name}]" for name in group.commands}
    found: dict[str, Any] = {}
    for name, value in table.items():
        if name not in known or not isinstance(value, dict):
            raise InputError(f"{place}: there is no command for '{name}'; {suggest(name, known.values())}")
        found[name] = defaults_of(group.commands[name], value, f"{place}: [{name}]")
    return found


def command_defaults(command: Command, table: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Values of a command's options by the names of its parameters, checked."""
    types = get_type_hints(command.callback)
    options = {
        option.removeprefix("--"): parameter.name
        for parameter in command.params
        if parameter.param_type_name == "option"
        for option in parameter.opts
    }
    found: dict[str, Any] = {}
    for written, value in table.items():
        name = written.replace("_", "-")
        if name not in options or options[name] not in types:
            raise InputError(f"{place} has no option '{written}'; {suggest(name, options)}")
        check_type(value, types[options[name]], f"{place} {written}")
        found[options[name]] = value
    return found


def check_type(value: object, expected: Any, place: str) -> None:
    """InputError unless the value is of the option's own type."""
    try:
        msgspec.convert(value, expected, dec_hook=lambda _, text: Path(msgspec.convert(text, str)))
    except msgspec.ValidationError as error:
        fault = str(error).replace(" | null", "").replace("`", "").lower()
        raise InputError(f"{place} = {value!r}: {fault}; write it as the option needs it") from error


def suggest(name: str, known: Iterable[str]) -> str:
    """What was meant, or all that there is."""
    known = sorted(known)
    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
