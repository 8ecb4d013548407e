"""The tests themselves: what they share stands in tests/support, so that each can be read by itself."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


def imported(path: Path) -> Iterator[str]:
    """Full names of all that a module imports, at any depth of it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def in_test_modules(names: Iterator[str]) -> list[str]:
    """Those of the names that lead into a test module."""
    return [
        name
        for name in names
        if name.startswith("tests.") and any(part.startswith("test_") for part in name.split("."))
    ]


@pytest.mark.parametrize("path", sorted(TESTS.rglob("*.py")), ids=lambda path: str(path.relative_to(TESTS)))
def test_no_module_imports_a_test_module(path: Path) -> None:
    """What two test modules share is in neither of them."""
    assert in_test_modules(imported(path)) == []


def test_an_import_of_a_test_module_is_seen(tmp_path: Path) -> None:
    """In whatever form, also below the top of a file."""
    (tmp_path / "x.py").write_text(
        "from tests.pool.test_pool import MODEL\nfrom tests.support import bodies\n"
        "def later():\n    import tests.pool.test_pool as pool\n    from tests.pool import test_pool\n"
    )
    assert len(in_test_modules(imported(tmp_path / "x.py"))) == 3
