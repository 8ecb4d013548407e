"""How long a worker takes until it announces itself, kernels compiled before, and how large it then is."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.costs.standing import standing
from common.settings import preset
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.tracking.observing.sensor_noise import SensorNoise

POINTS = 5_000


def worker_start(rounds: int, lanes: int) -> dict[str, Any]:
    """Median seconds until the local worker is there, of which its processor's; megabytes after a frame."""
    starts = np.array([start_one(lanes) for _ in range(1 + rounds)][1:])
    seconds, processor, size = np.median(starts, axis=0).tolist()
    return {"lanes": lanes, "seconds": seconds, "processor_seconds": processor, "megabytes": size}


def start_one(lanes: int) -> tuple[float, float, float]:
    """Seconds, seconds of its processor and megabytes of a fresh worker."""
    case = standing(POINTS, SensorNoise(), 0)
    began = time.perf_counter()
    with ZenohRefiner(Pool(workers=lanes)) as refiner:
        refiner.wait_for(lanes)
        seconds = time.perf_counter() - began
        (pid,) = refiner.local_pids.values()
        processor = processor_seconds(pid)
        refiner.publish(case.subject)
        poses = np.repeat(case.start, 4 * lanes, axis=0)
        refiner.submit(case.model, poses, preset("default").refine).result()
        return seconds, processor, resident_megabytes(pid)


def processor_seconds(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_megabytes(pid: int) -> float:
    """Memory that a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
