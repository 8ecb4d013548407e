"""Compiled kernels are kept while all the sources that they stand on stay the same, and not longer."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from common.kernel_cache import VARIABLE

ROOT = Path(__file__).parents[2]
CALLER = """from common.compiling import numba
from worker.callee import twice

@numba.njit(cache=True)
def four_times(x):
    return twice(twice(x))
"""
CALLEE = """from common.compiling import numba
from worker.constants import FACTOR

@numba.njit(cache=True)
def twice(x):
    return FACTOR * x
"""
RUN = "from worker.caller import four_times as f; print(f(1), sum(f.stats.cache_hits.values()))"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A kernel that calls one of another file, which takes a constant from a third."""
    shutil.copytree(ROOT / "common", tmp_path / "common", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "worker").mkdir()
    for name, text in (
        ("__init__", ""),
        ("caller", CALLER),
        ("callee", CALLEE),
        ("constants", "FACTOR = 2\n"),
    ):
        (tmp_path / "worker" / f"{name}.py").write_text(text)
    return tmp_path


@pytest.mark.parametrize("where", ["beside the source", "in a folder"])
def test_a_kernel_is_compiled_anew_when_what_it_calls_changed(checkout: Path, where: str) -> None:
    """Whether code or a constant; a file that it does not stand on, or none, changes nothing."""
    folder = {} if where == "beside the source" else {VARIABLE: str(checkout / "kernels")}
    clean = {name: value for name, value in os.environ.items() if name != VARIABLE}

    def result() -> str:
        environment = {**clean, **folder, "PYTHONPATH": str(checkout)}
        done = subprocess.run(
            [sys.executable, "-c", RUN],
            cwd=checkout,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    assert [result(), result()] == ["4 0", "4 1"]
    (checkout / "worker" / "constants.py").write_text("FACTOR = 3\n")
    assert [result(), result()] == ["9 0", "9 1"]
    (checkout / "worker" / "callee.py").write_text(CALLEE.replace("FACTOR * x", "FACTOR * x + 1"))
    assert result() == "13 0"
    (checkout / "worker" / "other.py").write_text("FACTOR = 5\n")
    assert result() == "13 1"


def test_no_file_takes_numba_from_elsewhere() -> None:
    """It would keep its kernels though what they call has changed."""
    files = [
        file
        for folder in ("common", "worker", "coordinator", "gepf")
        for file in (ROOT / folder).rglob("*.py")
    ]
    direct = [file.name for file in files if re.search(r"^ *import numba", file.read_text(), re.MULTILINE)]
    assert direct == ["compiling.py"]
