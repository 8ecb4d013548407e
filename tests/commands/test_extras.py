"""What is installed without extras."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
BEHIND = {"scipy"}  # numba calls its LAPACK where a kernel has np.linalg
MODULES = {"eclipse-zenoh": "zenoh"}  # package -> what is imported, where that differs


def imported(file: Path) -> Iterator[str]:
    """The packages that a module imports, wherever it does so."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module.partition(".")[0]


def test_the_base_install_is_what_a_worker_imports() -> None:
    """Exactly the packages that a worker needs."""
    declared = {re.split(r"[^\w-]", requirement)[0] for requirement in PROJECT["dependencies"]}
    files = [file for room in ("common", "worker") for file in (ROOT / room).rglob("*.py")]
    foreign = {name for file in files for name in imported(file)} - set(sys.stdlib_module_names)
    assert (foreign - {"common", "worker"}) | BEHIND == {MODULES.get(name, name) for name in declared}
