"""Tests share code through tests.support alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]


def imported(file: Path) -> Iterator[str]:
    """The full names of what a file imports."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{name.name}" for name in node.names)


def test_no_test_is_imported() -> None:
    """By another test, by what they share, or by a benchmark: it could not be changed alone."""
    files = [file for folder in ("tests", "benchmarks", "examples") for file in (ROOT / folder).rglob("*.py")]
    assert len(files) > 200
    found = {
        (file.relative_to(ROOT).as_posix(), name)
        for file in files
        for name in imported(file)
        if name.startswith("tests.") and ".test_" in name
    }
    assert found == set()
