"""How long a worker takes until it announces itself, kernels compiled before, and how large it then is."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner


def worker_start(rounds: int) -> dict[str, Any]:
    """Median seconds until one local worker is there, of which its processor's; megabytes that it holds."""
    starts = np.array([start_one() for _ in range(1 + rounds)][1:])
    seconds, processor, size = np.median(starts, axis=0).tolist()
    return {"seconds": seconds, "processor_seconds": processor, "megabytes": size}


def start_one() -> tuple[float, float, float]:
    """Seconds, seconds of its processor and megabytes of a fresh worker."""
    began = time.perf_counter()
    with ZenohRefiner(Pool(workers=1)) as refiner:
        refiner.wait_for(1)
        seconds = time.perf_counter() - began
        (pid,) = refiner.local_pids.values()
        return seconds, processor_seconds(pid), resident_megabytes(pid)


def processor_seconds(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_megabytes(pid: int) -> float:
    """Memory that a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
