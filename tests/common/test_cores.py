"""How many cores a process may use: affinity, and the quotas of control groups."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gepf.common.cores import usable_cores

ALLOWED = len(os.sched_getaffinity(0))


@pytest.mark.parametrize(
    ("files", "cores"),
    [
        ({"groups/cpu.max": "max 100000\n"}, ALLOWED),
        ({"groups/cpu.max": "100000 100000\n"}, 1),
        ({"groups/cpu.max": "30000 100000\n"}, 1),  # part of a core counts as one
        ({"groups/cpu.max": "what is this\n"}, ALLOWED),
        (
            {
                "membership": "0::/pods/worker\n",
                "groups/pods/cpu.max": "100000 100000\n",
                "groups/pods/worker/cpu.max": "max 100000\n",
            },
            1,
        ),
    ],
    ids=["none", "whole", "part", "damaged", "of a group above"],
)
def test_quotas_of_control_groups_limit_the_affinity(
    tmp_path: Path, files: dict[str, str], cores: int
) -> None:
    """Quotas of all groups of the process; unreadable ones set no limit."""
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert usable_cores(tmp_path / "groups", tmp_path / "membership") == cores
