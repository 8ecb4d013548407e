"""docs/architecture.md is true: its rooms, its files and the functions that it names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGES = ("common", "coordinator", "gepf", "worker")
NAMES = r"(?:,? ?(?:and )?\s?`[A-Za-z_]\w*(?:\.\w+)?`)*"
REFERENCES = {
    (path, name)
    for path, names in re.findall(rf"`([\w/]+\.py)`({NAMES})", TEXT)
    for name in ("", *re.findall(r"`([\w.]+)`", names))
}


def listed_rooms() -> list[str]:
    """The folders of the tree, as paths."""
    (tree,) = re.findall(r"```text\n(.*?)```", TEXT, re.DOTALL)
    rooms, parent = [], ""
    for line in tree.splitlines():
        name = line.split()[0].rstrip("/")
        parent = parent if line.startswith(" ") else name
        rooms.append(f"{parent}/{name}" if line.startswith(" ") else name)
    return rooms


def actual_rooms() -> set[str]:
    """The packages that are installed, and those in them."""
    inner = [init.parent for name in PACKAGES for init in (ROOT / name).glob("*/__init__.py")]
    return {*PACKAGES, *(str(folder.relative_to(ROOT)) for folder in inner)}


def defined(file: Path) -> set[str]:
    """Functions, classes and methods (with their class) of a module."""
    found = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)
            }
    return found


def test_the_tree_has_every_room_and_no_other() -> None:
    """A room that is new, or gone, is so in the document, too."""
    rooms = listed_rooms()
    assert len(rooms) == len(set(rooms))
    assert {room for room in rooms if room.partition("/")[0] in PACKAGES} == actual_rooms()
    assert all((ROOT / room).is_dir() for room in rooms)


def test_every_room_has_a_line_that_says_what_it_is() -> None:
    """Name and words."""
    for room in listed_rooms():
        assert re.search(rf"^ *{Path(room).name}/ +\w+", TEXT, re.MULTILINE), room


@pytest.mark.parametrize(("path", "name"), sorted(REFERENCES), ids=" ".join)
def test_every_named_file_and_function_is_there(path: str, name: str) -> None:
    """Functions and methods stand after the file that defines them."""
    assert (ROOT / path).is_file()
    assert not name or name in defined(ROOT / path)


def test_enough_is_named_to_find_the_way() -> None:
    """The way of one frame names a function at each of its steps."""
    steps = re.findall(r"^\| \d+ \|.*$", TEXT, re.MULTILINE)
    assert len(steps) > 10
    assert all(re.search(r"\.py` `\w", step) for step in steps)
