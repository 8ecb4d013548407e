"""Times of several calls, taken in turns so that whatever slows the machine down slows all of them."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Call = Callable[[], object]


def stay_on_one_core() -> None:
    """Pin the process to one of its cores, so that no library can use a second thread's worth of time.

    To be called before such libraries start their threads.
    """
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def take_turns(calls: Mapping[str, Call], rounds: int) -> dict[str, NDArray[np.float64]]:
    """Milliseconds (rounds,) of processor time of every call, after one round that does not count.

    One of each a round. Processor time is that of all threads; what waits for its turn costs nothing.
    """
    spent: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(1 + rounds):
        for name, call in calls.items():
            began = time.process_time()
            call()
            spent[name].append(1e3 * (time.process_time() - began))
    return {name: np.array(times[1:]) for name, times in spent.items()}


def machine(*packages: str) -> dict[str, str]:
    """What the times belong to: processor, Python, versions of packages."""
    return {
        "processor": _processor(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
    }


def _processor() -> str:
    """The processor's name as Linux gives it."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
