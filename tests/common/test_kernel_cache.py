"""Compiled kernels of an installed gepf are kept by the state of its sources."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from common.kernel_cache import VARIABLE, state_of
from tests.support.processes.programs import fresh_python

ROOT = Path(__file__).parents[2]
SHOW = f"import worker, os, sys; print('numba' in sys.modules, os.environ.get({VARIABLE!r}))"


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copy of the packages as pip lays them out, without a project beside them."""
    for package in ("common", "worker"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def shown(root: Path, **environment: str) -> str:
    """Whether numba is loaded, and where kernels are kept, in a fresh process."""
    done = fresh_python(root, SHOW, **environment)
    done.check_returncode()
    return done.stdout.strip()


def test_an_installed_one_keeps_them_by_source(installed: Path) -> None:
    """The folder is chosen before numba is loaded; another state of the sources has another folder."""
    before = shown(installed, XDG_CACHE_HOME="/cache")
    assert before == f"False /cache/gepf/kernels-{state_of(installed)}"
    assert shown(installed, XDG_CACHE_HOME="/cache") == before
    (installed / "worker" / "lanes.py").write_text('"""Another one."""\n', encoding="utf-8")
    assert shown(installed, XDG_CACHE_HOME="/cache") != before


def test_what_the_user_says_counts(installed: Path) -> None:
    """A folder that is named in the environment, as in the images, is left alone."""
    assert shown(installed, **{VARIABLE: "/mine"}) == "False /mine"


def test_a_checkout_keeps_them_beside_the_source() -> None:
    """So `make clean-kernels` finds them."""
    assert shown(ROOT) == "False None"
