"""Commands whose parameters are dataclasses of options, for typer."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_type_hints

from common.errors import InputError


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer, with the fields of the dataclasses that are the parameters of `command`.

    Names of fields must differ within a command. Every option that is a quantity must be above zero.
    """
    kinds = get_type_hints(command, include_extras=True)
    flat, groups = list[inspect.Parameter](), dict[str, Any]()
    for name, parameter in inspect.signature(command).parameters.items():
        kind = kinds[name]
        if is_dataclass(kind):
            groups[name] = kind
            flat += parameters_of(kind)
        else:
            flat.append(parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=kind))

    def run(**values: Any) -> None:
        for name, value in values.items():
            if isinstance(value, float) and not 0.0 < value < math.inf:
                raise InputError(f"--{name.replace('_', '-')} {value:g} is not above 0; give another number")
        built = {
            name: make(**{field.name: values.pop(field.name) for field in fields(make)})
            for name, make in groups.items()
        }
        command(**built, **values)

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in flat}
    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run


def parameters_of(kind: Any) -> list[inspect.Parameter]:
    """A parameter for each field of a dataclass."""
    types, found = get_type_hints(kind, include_extras=True), list[inspect.Parameter]()
    for each in fields(kind):
        default = inspect.Parameter.empty if each.default is MISSING else each.default
        shown = each.metadata.get("typer")
        annotation = types[each.name] if shown is None else Annotated[types[each.name], shown]
        found.append(
            inspect.Parameter(
                each.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
            )
        )
    return found
