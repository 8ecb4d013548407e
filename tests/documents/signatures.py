"""The signatures of the library's public names, as `docs/library.md` shows them.

`python -m tests.documents.signatures` writes them there.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gepf

PAGE = Path(__file__).parents[2] / "docs" / "library.md"
BEGIN, END = "<!-- signatures: python -m tests.documents.signatures -->", "<!-- end of signatures -->"
ROOMS = re.compile(r"\b(?:common|coordinator|gepf|numpy|np|collections\.abc|pathlib)(?:\.\w+)*\.(?=[A-Z])")


def signatures() -> str:
    """One line a public name, and one for each of its methods and properties."""
    lines = [line for name in gepf.__all__ for line in lines_of(name, getattr(gepf, name))]
    return "\n".join([BEGIN, "```text", *lines, "```", END])


def lines_of(name: str, thing: Any) -> Iterator[str]:
    """A name with its parameters, then what it has."""
    if inspect.isfunction(thing):
        yield f"{name}{shown(thing)}"
        return
    made = name in ("ArraySource", "DepthFrame", "Intrinsics", "PeopleTracker", "TlsFiles", "Tracker")
    yield f"class {name}{shown(thing).removesuffix(' -> None')}" if made else f"class {name}"
    if issubclass(thing, Exception):
        return
    for part, value in sorted(vars(thing).items()):
        if part.startswith("_"):
            continue
        if inspect.isfunction(value):
            yield f"    .{part}{shown(value)}"
        elif isinstance(value, classmethod):
            yield f"    {name}.{part}{shown(value.__func__)}"
        elif isinstance(value, property):
            kind = inspect.signature(value.fget).return_annotation if value.fget else "Any"
            yield f"    .{part}: {plain(str(kind))}"


def shown(function: Any) -> str:
    """Parameters without the first of methods, and without the rooms of types."""
    signature = inspect.signature(function)
    kept = [p for n, p in signature.parameters.items() if n not in ("self", "cls")]
    return plain(str(signature.replace(parameters=kept)))


def plain(text: str) -> str:
    """Types by their own names, without quotes."""
    return ROOMS.sub("", text.replace("'", ""))


def embedded(page: str) -> str:
    """The page with these signatures."""
    before, _, rest = page.partition(BEGIN)
    return before + signatures() + rest.partition(END)[2]


if __name__ == "__main__":
    PAGE.write_text(embedded(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
