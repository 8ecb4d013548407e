"""docs/settings.md is true: every setting of descent and filter with its values, and constants that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import msgspec
import pytest

from common.settings import PRESETS, FilterSettings, RefineSettings

ROOT = Path(__file__).parents[2]
SETTINGS, CONSTANTS = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8").split("## What nobody can")
MOST_SETTINGS = 12
FILES = re.findall(r"^\| `([\w/]+\.py)` \| (.+?) \|", CONSTANTS, re.MULTILINE)


def rows() -> dict[str, tuple[str, str]]:
    """Setting -> its values in both presets, as the page shows them."""
    found = re.findall(r"^\| (`.+?`) \| (.+?) \| (.+?) \|", SETTINGS, re.MULTILINE)
    return {
        name: (paper, default) for names, paper, default in found for name in re.findall(r"`(\w+)`", names)
    }


def assigned(file: Path) -> set[str]:
    """Names that a module gives a value to."""
    names: set[str] = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)}
    return names


def test_every_setting_is_there_and_no_other() -> None:
    """All of descent and filter, a dozen at the most."""
    fields = [*RefineSettings.__struct_fields__, *FilterSettings.__struct_fields__]
    assert sorted(rows()) == sorted(fields)
    assert len(fields) <= MOST_SETTINGS


@pytest.mark.parametrize("name", rows())
def test_values_are_those_of_the_presets(name: str) -> None:
    """A number in other units, a word, yes or no, or none."""
    for shown, preset in zip(rows()[name], ("paper", "default"), strict=True):
        settings = PRESETS[preset]
        values = msgspec.structs.asdict(settings.refine) | msgspec.structs.asdict(settings.filter)
        assert value_of(shown) == pytest.approx(values[name]), preset


def value_of(shown: str) -> object:
    """What a cell says, in metres, radians and degrees."""
    known: dict[str, object] = {"yes": True, "no": False, "none": 0.0}
    number, _, unit = shown.partition(" ")
    if shown in known or not re.fullmatch(r"[\d.]+", number):
        return known.get(shown, shown)
    return float(number) * {"": 1.0, "cm": 0.01, "mm": 0.001, "rad": 1.0}[unit]


@pytest.mark.parametrize(("file", "names"), FILES, ids=[file for file, _ in FILES])
def test_constants_exist(file: str, names: str) -> None:
    """What a table names a module holds."""
    listed = re.findall(r"`(\w+)`", names)
    assert listed
    assert set(listed) <= assigned(ROOT / file)
