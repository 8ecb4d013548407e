"""Compiled kernels are cached while all sources that they depend on are unchanged, and not longer."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import pytest

from tests.support.processes.programs import CACHE, fresh_python

ROOT = Path(__file__).parents[2]
CALLER = """from gepf.common.compiling import numba
from gepf.worker.callee import twice

@numba.njit(cache=True)
def four_times(x):
    return twice(twice(x))
"""
CALLEE = """from gepf.common.compiling import numba
from gepf.worker.constants import FACTOR

@numba.njit(cache=True)
def twice(x):
    return FACTOR * x
"""
RUN = "from gepf.worker.caller import four_times as f; print(f(1), sum(f.stats.cache_hits.values()))"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A kernel that calls one of another file, which takes a constant from a third."""
    shutil.copytree(ROOT / "common", tmp_path / "common", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "gepf").mkdir()
    (tmp_path / "gepf" / "__init__.py").touch()
    (tmp_path / "worker").mkdir()
    for folder in ("common", "worker"):
        (tmp_path / "gepf" / folder).symlink_to(tmp_path / folder)
    for name, text in (
        ("__init__", ""),
        ("caller", CALLER),
        ("callee", CALLEE),
        ("constants", "FACTOR = 2\n"),
    ):
        (tmp_path / "worker" / f"{name}.py").write_text(text)
    return tmp_path


def result(root: Path, **environment: str) -> str:
    """The kernel's result, and its number of cache hits, in a new process."""
    return fresh_python(root, RUN, **environment).stdout.strip()


def test_a_kernel_is_compiled_anew_when_what_it_stands_on_changed(checkout: Path) -> None:
    """A called kernel or its constant; it stays cached if nothing or an unrelated file changes."""
    assert result(checkout) == "4 0"
    (checkout / "worker" / "other.py").write_text("FACTOR = 5\n")
    assert result(checkout) == "4 1"
    (checkout / "worker" / "constants.py").write_text("FACTOR = 3\n")
    assert result(checkout) == "9 0"
    (checkout / "worker" / "callee.py").write_text(CALLEE.replace("FACTOR * x", "FACTOR * x + 1"))
    assert result(checkout) == "13 0"


@pytest.mark.slow
def test_a_process_that_was_killed_leaves_no_earlier_kernel_behind(checkout: Path) -> None:
    """Killed between writing the index and the kernel."""
    assert fresh_python(checkout, RUN).stdout == "4 0\n"
    (checkout / "worker" / "constants.py").write_text("FACTOR = 3\n")
    index = "from numba.core.caching import IndexDataCacheFile as index"
    end = "index._save_data = lambda *_: os._exit(7)"
    assert fresh_python(checkout, f"import os; {index}; {end}; {RUN}").returncode == 7
    assert [fresh_python(checkout, RUN).stdout for _ in range(2)] == ["9 0\n", "9 1\n"]


@pytest.mark.slow
def test_kernels_of_other_packages_are_kept_as_numba_keeps_them(checkout: Path) -> None:
    """Whether gepf is loaded beside them or not, and however their source is encoded."""
    theirs = CALLEE.replace("gepf.common.compiling import numba", "numba import njit").replace(
        "numba.njit", "njit"
    )
    text = "# -*- coding: latin-1 -*-\n# caf\xe9\n" + theirs.replace(
        "from gepf.worker.constants import FACTOR", "FACTOR = 2"
    )
    (checkout / "theirs.py").write_bytes(text.encode("latin-1"))
    use = "from theirs import twice as f; print(f(1), sum(f.stats.cache_hits.values()))"
    beside = f"import gepf.common.compiling; {use}"
    assert [fresh_python(checkout, code).stdout.strip() for code in (use, beside, use)] == [
        "2 0",
        "2 1",
        "2 1",
    ]


def test_where_nothing_can_be_written_the_user_is_told_what_helps(checkout: Path) -> None:
    """Neither beside the source nor in the user's cache; with a folder that can be, all is well."""
    (checkout / "worker" / "__pycache__").touch()
    nowhere = {"XDG_CACHE_HOME": os.devnull, "PYTHONDONTWRITEBYTECODE": "1"}
    told = fresh_python(checkout, RUN, **nowhere)
    assert re.search(rf"InputError: compiled kernels cannot be kept .*{CACHE}", told.stderr)
    assert fresh_python(checkout, RUN, **nowhere, **{CACHE: str(checkout / "kernels")}).stdout == "4 0\n"


def test_no_file_takes_numba_from_elsewhere() -> None:
    """Otherwise kernels would stay cached although a called kernel has changed."""
    files = [
        file
        for folder in ("common", "worker", "coordinator", "gepf")
        for file in (ROOT / folder).rglob("*.py")
    ]
    elsewhere = re.compile(
        r"^ *(import numba|from numba import .*\b(n?jit|(gu)?vectorize|stencil)\b)", re.MULTILINE
    )
    direct = [file.name for file in files if elsewhere.search(file.read_text())]
    assert direct == ["compiling.py"]
