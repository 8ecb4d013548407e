"""What is compared: preset default, each of its settings changed alone, and the simplest things."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import msgspec

from benchmarks.frame_rates.rows import STILL, Row
from common.errors import InputError
from common.settings import PRESETS

WHOLE = "preset default"
ONE_PARTICLE = "1 particle"


def choose_rows(only: Sequence[str] | None = None) -> tuple[Row, ...]:
    """The unchanged preset first, then a row for each refine and filter setting, then the simplest things.

    `only`: of the settings these; InputError for one that there is not.
    """
    rows = {change.partition("=")[0]: Row(change, (change,)) for change in changes()}
    for name in only or ():
        if name not in rows:
            raise InputError(f"no setting '{name}'; choose from {', '.join(rows)}")
    changed = rows.values() if only is None else [rows[name] for name in only]
    return (Row(WHOLE), *changed, Row(ONE_PARTICLE, particles=1), Row(STILL, None))


def changes() -> list[str]:
    """`key=value` for every refine and filter setting of preset default."""
    paper, default = (msgspec.to_builtins(PRESETS[name]) for name in ("paper", "default"))
    return [
        f"{key}={text(other(value, paper[part][key]))}"
        for part in ("refine", "filter")
        for key, value in default[part].items()
    ]


def other(mine: Any, papers: Any) -> Any:
    """The paper's value; where that is the same, half of a count or the double of another number."""
    if papers != mine:
        return papers
    return mine // 2 if isinstance(mine, int) else 2.0 * mine


def text(value: Any) -> str:
    """As `key=value` has it."""
    return value if isinstance(value, str) else json.dumps(value)
