"""Frames per second at which a real person is tracked: python -m benchmarks.costs.video_rate.

20 particles, 5 000 points, preset `default`, a local worker with one lane and with two, as `gepf track` but
without files: frames are read from memory and nothing is recorded. The recordings alternate, several rounds.
The share of processor time that the host gave to other machines (steal) is printed too.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.costs.service import processor_seconds
from benchmarks.recordings import choose, find_people, read_frames
from benchmarks.running import add_data, command_line, keep, measured
from gepf.common.frame import Frame
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.tracker import Tracker

RECORDINGS = ("a8_s1", "a14_s2", "a21_s1", "a27_s2")
LANES = (2, 1)
POINTS = 5_000
SETTLED = 4  # frames that do not count: the body is detected in the first


def main() -> int:
    """Measure, print, write the numbers."""
    parser = command_line("costs.video_rate", __doc__)
    add_data(parser)
    parser.add_argument("--rounds", type=int, default=5)
    return measured(measure, parser.parse_args())


def measure(chosen: argparse.Namespace) -> int:
    """Measure and print."""
    found = {one.name: read_frames(one) for one in choose(find_people(chosen.data), RECORDINGS)}
    runs = []
    for _ in range(chosen.rounds):
        for name, frames in found.items():
            for lanes in LANES:
                one = {"recording": name, **run(frames, lanes)}
                runs.append(one)
                print(
                    ", ".join(
                        f"{key} {value:.1f}" if isinstance(value, float) else f"{value}"
                        for key, value in one.items()
                    )
                )
    keep(runs, chosen.out)
    return 0


def run(frames: list[Frame], lanes: int) -> dict[str, Any]:
    """Frames per second, processor milliseconds per frame, and the share of the machine that others used."""
    settings = msgspec.structs.replace(preset("default"), points=POINTS)
    with ZenohRefiner(Pool(workers=lanes)) as refiner:
        refiner.wait_for(lanes)
        tracker = Tracker(refiner, settings, choose_bodies(None, settings.preset))
        at = []  # after the frames that do not count, and after the last frame
        for count, _ in enumerate(tracker.follow(frames)):
            if count in (SETTLED, len(frames) - 1):
                at.append(spent(refiner))
    wall, coordinator, worker, stolen, ticks = np.subtract(at[1], at[0]).tolist()
    count = len(frames) - 1 - SETTLED
    return {
        "lanes": float(lanes),
        "frames_per_second": count / wall,
        "coordinator_ms": 1e3 * coordinator / count,
        "worker_ms": 1e3 * worker / count,
        "stolen_percent": 100.0 * stolen / max(ticks, 1.0),
    }


def spent(refiner: ZenohRefiner) -> tuple[float, ...]:
    """Seconds so far: wall time, processor time of coordinator and worker; ticks stolen, and all ticks."""
    ticks = [int(word) for word in Path("/proc/stat").read_text(encoding="utf-8").split()[1:9]]
    worker = processor_seconds(refiner.local_pid)
    return time.perf_counter(), time.process_time(), worker, ticks[7], sum(ticks)


if __name__ == "__main__":
    sys.exit(main())
