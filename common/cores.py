"""The number of processor cores that this process may use."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path


def usable_cores(cgroups: Path = Path("/sys/fs/cgroup"), membership: Path = Path("/proc/self/cgroup")) -> int:
    """Cores that affinity and the control groups of this process allow, at least one.

    A fraction of a core counts as a whole core. Container engines and Kubernetes set such quotas.

    Args:
        cgroups: Mount point of control groups, version 2.
        membership: File with the group of this process.
    """
    allowed = len(os.sched_getaffinity(0))
    groups = [cgroups]  # in a container, the root is the group of this process
    with suppress(OSError, IndexError):
        own = cgroups / membership.read_text(encoding="utf-8").split("::/")[1].strip()
        groups += [own, *own.parents]
    for group in groups:
        with suppress(OSError, ValueError):  # "max" is no limit
            quota, period = (group / "cpu.max").read_text(encoding="utf-8").split()
            allowed = min(allowed, math.ceil(float(quota) / float(period)))
    return max(1, allowed)
