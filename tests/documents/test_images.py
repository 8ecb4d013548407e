"""The recipes of the images: what cannot be tried without building them is tried as far as it can."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCKER = Path(__file__).parents[2] / "docker"
CODE = re.compile(r"""python [^"\n]*-c "([^"]+)\"""")


@pytest.mark.parametrize("name", ["worker.Dockerfile", "coordinator.Dockerfile", "test.sh"])
def test_the_python_in_a_recipe_runs(name: str) -> None:
    """Each piece of code calls what there is, as it is there."""
    pieces = CODE.findall((DOCKER / name).read_text())
    assert pieces
    for piece in pieces:
        exec(piece, {})
