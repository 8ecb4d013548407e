"""How many processor cores this process may use."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path

CGROUPS = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")


def usable_cores(cgroups: Path = CGROUPS, membership: Path = MEMBERSHIP) -> int:
    """Cores that affinity and the control groups of this process allow, at least one.

    A quota of part of a core counts as a whole one. Container engines and Kubernetes set quotas.

    Args:
        cgroups: Where the control groups are mounted, version 2 or 1.
        membership: The file that names the groups of this process.
    """
    allowed = len(os.sched_getaffinity(0))
    quotas = [quota for folder in own_groups(cgroups, membership) for quota in read_quotas(folder)]
    return max(1, min([allowed, *(math.ceil(quota) for quota in quotas)]))


def own_groups(cgroups: Path, membership: Path) -> list[Path]:
    """Folders of the groups of this process and of all groups that hold these."""
    folders = [cgroups, cgroups / "cpu"]  # in a container its own group is the root
    with suppress(OSError):
        for line in membership.read_text(encoding="utf-8").splitlines():
            _, controllers, name = line.split(":", 2)
            if controllers in ("", "cpu", "cpu,cpuacct"):
                base = cgroups if controllers == "" else cgroups / "cpu"
                parts = [part for part in name.split("/") if part not in ("", "..")]
                folders += [base.joinpath(*parts[:k]) for k in range(1, len(parts) + 1)]
    return folders


def read_quotas(folder: Path) -> list[float]:
    """Cores by the quota of one group; empty where it has none."""
    with suppress(OSError, ValueError):
        quota, period = (folder / "cpu.max").read_text(encoding="utf-8").split()
        return [] if quota == "max" else [float(quota) / float(period)]
    with suppress(OSError, ValueError):
        limit = float((folder / "cpu.cfs_quota_us").read_text(encoding="utf-8"))
        period_us = float((folder / "cpu.cfs_period_us").read_text(encoding="utf-8"))
        return [limit / period_us] if limit > 0 else []
    return []
