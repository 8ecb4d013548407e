"""Options in groups: a command takes dataclasses, and typer sees each of their fields as a parameter."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_type_hints


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer with the fields of the dataclasses that `command` takes, however deep they stand.

    Names of fields must differ within a command. Their types say with `Annotated` what typer is to know.
    """
    kinds = get_type_hints(command, include_extras=True)
    kinds.pop("return", None)
    defaults = {name: parameter.default for name, parameter in inspect.signature(command).parameters.items()}
    flat = [p for name, kind in kinds.items() for p in expand(name, kind, defaults[name])]

    def run(**values: Any) -> None:
        command(**{name: build(name, kind, values) for name, kind in kinds.items()})

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run


def expand(name: str, kind: Any, default: Any = inspect.Parameter.empty) -> Iterator[inspect.Parameter]:
    """The parameters that one parameter stands for: itself, or those of its fields."""
    if not is_dataclass(kind):
        yield inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        return
    kinds = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        yield from expand(field.name, kinds[field.name], default)


def build(name: str, kind: Any, values: dict[str, Any]) -> Any:
    """The value of one parameter from the values of all flat ones."""
    make: Callable[..., Any] = kind
    if not is_dataclass(kind):
        return values[name]
    kinds = get_type_hints(kind, include_extras=True)
    return make(**{field.name: build(field.name, kinds[field.name], values) for field in fields(kind)})
