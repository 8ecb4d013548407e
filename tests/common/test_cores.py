"""How many cores a process may use: affinity, and the quotas of control groups."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from common.cores import usable_cores

ALLOWED = len(os.sched_getaffinity(0))


def write(file: Path, text: str) -> None:
    """Write a file and the folders above it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


def test_without_a_quota_it_is_the_affinity(tmp_path: Path) -> None:
    """Where no group sets a quota, all cores of the affinity may be used."""
    write(tmp_path / "groups" / "cpu.max", "max 100000\n")
    assert usable_cores(tmp_path / "groups", tmp_path / "no-file") == ALLOWED


@pytest.mark.parametrize(("quota", "cores"), [("100000 100000", 1), ("30000 100000", 1), ("50000 100000", 1)])
def test_a_quota_of_version_2_limits(tmp_path: Path, quota: str, cores: int) -> None:
    """`cpu.max` of the root, as in a container, is a limit; part of a core counts as one."""
    write(tmp_path / "cpu.max", quota + "\n")
    assert usable_cores(tmp_path, tmp_path / "no-file") == cores


def test_a_quota_of_a_group_above_limits(tmp_path: Path) -> None:
    """The quota of any group that holds the process counts, not only that of its own."""
    write(tmp_path / "membership", "0::/pods/worker\n")
    write(tmp_path / "groups" / "pods" / "cpu.max", "100000 100000\n")
    write(tmp_path / "groups" / "pods" / "worker" / "cpu.max", "max 100000\n")
    assert usable_cores(tmp_path / "groups", tmp_path / "membership") == 1


def test_a_quota_of_version_1_limits(tmp_path: Path) -> None:
    """`cpu.cfs_quota_us` of version 1 is a limit; -1 is none."""
    write(tmp_path / "cpu" / "cpu.cfs_quota_us", "-1\n")
    write(tmp_path / "cpu" / "cpu.cfs_period_us", "100000\n")
    assert usable_cores(tmp_path, tmp_path / "no-file") == ALLOWED
    write(tmp_path / "cpu" / "cpu.cfs_quota_us", "80000\n")
    assert usable_cores(tmp_path, tmp_path / "no-file") == 1


def test_a_damaged_file_is_no_limit(tmp_path: Path) -> None:
    """What cannot be read limits nothing."""
    write(tmp_path / "cpu.max", "what is this\n")
    assert usable_cores(tmp_path, tmp_path / "no-file") == ALLOWED
