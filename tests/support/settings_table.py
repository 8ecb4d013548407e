"""The tables of docs/settings.md: each setting with its default, and what it means or where it was measured.

`python -m tests.support.settings_table` writes them into the page.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from gepf.coordinator.settings import preset

PAGE = Path(__file__).parents[2] / "docs" / "settings.md"
START, END = "<!-- settings: make with tests.support.settings_table -->\n", "<!-- end -->\n"


class Setting(NamedTuple):
    """A setting by its dotted name, its value in preset `default`, and what its struct says of it."""

    name: str
    value: object
    origin: str


def settings_of(struct: msgspec.Struct, prefix: str = "") -> Iterator[Setting]:
    """All settings of a struct and of the structs in it."""
    origins = origins_of(type(struct))
    for name in struct.__struct_fields__:
        value = getattr(struct, name)
        if isinstance(value, msgspec.Struct):
            yield from settings_of(value, f"{prefix}{name}.")
        else:
            yield Setting(prefix + name, value, origins.get(name, ""))


def origins_of(kind: type[msgspec.Struct]) -> dict[str, str]:
    """What the source says of each field: after `#:`, or in the string below it."""
    source = inspect.getsource(kind)
    comments = re.findall(r"^    (\w+): .*?#: (.+)$", source, flags=re.MULTILINE)
    strings = re.findall(r'^    (\w+): [^\n]*\n    """(.+?)"""', source, flags=re.MULTILINE | re.DOTALL)
    return {name: " ".join(text.split()) for name, text in (*comments, *strings)}


def tables() -> str:
    """A table in Markdown for each stage."""
    groups: dict[str, list[Setting]] = {}
    for setting in settings_of(preset("default")):
        groups.setdefault(setting.name.rpartition(".")[0], []).append(setting)
    return "\n".join(f"{heading(group)}\n\n{table(settings)}" for group, settings in groups.items())


def heading(group: str) -> str:
    """The heading of a stage, and what its struct is."""
    struct: msgspec.Struct = preset("default")
    for name in filter(None, group.split(".")):
        struct = getattr(struct, name)
    title = f"`{group}`" if group else "The run"
    return f"## {title}\n\n{' '.join((inspect.getdoc(type(struct)) or '').split())}"


def table(settings: list[Setting]) -> str:
    """The settings of one stage."""
    lines = ["| setting | default | meaning and origin |", "| --- | --- | --- |"]
    for name, value, origin in settings:
        shown = f"{value:.6g}" if isinstance(value, float) else str(value)
        lines.append(f"| `{name.rpartition('.')[2]}` | {shown} | {origin.replace('|', chr(92) + '|')} |")
    return "\n".join(lines) + "\n"


def with_tables(page: str) -> str:
    """The page with the present tables."""
    before, rest = page.split(START)
    _, after = rest.split(END)
    return before + START + "\n" + tables() + "\n" + END + after


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text()))
