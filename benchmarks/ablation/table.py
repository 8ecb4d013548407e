"""The table of all effects, as a document has it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.ablation.effects import Difference, Effect
from common.errors import InputError
from coordinator.files import write_atomically

BEGIN, END = "<!-- ablation -->", "<!-- end of ablation -->"


def markdown(effects: Sequence[Effect]) -> Iterator[str]:
    """A line for each row."""
    yield "| | within 10 cm | difference (95 %) | raw | difference (95 %) | shows |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for one in effects:
        cells = (
            one.row if " " in one.row else f"`{one.row}`",
            f"{one.percent:.1f} %",
            describe(one.difference),
            f"{one.raw_percent:.1f} %",
            describe(one.raw_difference),
            where_it_shows(one),
        )
        yield f"| {' | '.join(cells)} |"


def where_it_shows(one: Effect) -> str:
    """In which shares an interval leaves zero out."""
    shown = {"offsets removed": one.difference, "raw": one.raw_difference}
    found = [name for name, difference in shown.items() if difference is not None and difference.shows]
    nowhere = "" if one.difference is None else "no"
    return "both" if len(found) == 2 else (found or [nowhere])[0]


def describe(difference: Difference | None) -> str:
    """Points of per cent, and between what they are."""
    if difference is None:
        return ""
    return f"{difference.mean:+.1f} ({difference.low:+.1f} to {difference.high:+.1f})"


def write_into(document: Path, lines: Sequence[str]) -> None:
    """Put the table between the marks of a document; InputError where it has none."""
    before, begin, rest = document.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise InputError(f"{document} has no {BEGIN} and {END}; add both on lines of their own")
    text = "\n".join((before + begin, *lines, end + after))
    write_atomically(document, lambda file: file.write(text.encode()))
