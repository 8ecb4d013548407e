"""What is installed with the extras that pyproject.toml names."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

EXTRAS = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]


def installed(extra: str) -> set[str]:
    """Requirements of an extra, those of extras that it names among them."""
    found: set[str] = set()
    for requirement in EXTRAS[extra]:
        if requirement.startswith("gepf["):
            found |= installed(requirement.removeprefix("gepf[").removesuffix("]"))
        else:
            found.add(requirement)
    return found


@pytest.mark.parametrize("extra", ["view", "stereo"])
def test_extras_of_a_coordinator_hold_a_coordinator(extra: str) -> None:
    """Whoever installs one of them has the command that it is for."""
    assert installed(extra) > set(EXTRAS["coordinator"])
