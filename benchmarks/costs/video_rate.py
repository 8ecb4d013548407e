"""How many frames a second a real person is tracked at: python -m benchmarks.costs.video_rate.

20 particles, 5 000 points, preset `default`, one local worker and two, as `gepf track` does it but for the
files: frames are read from memory and nothing is recorded. Each sequence again and again, in turns. How much
of the processors' time the machine's host gave to others is told beside it. Without ../shared/data it says
so and measures nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.command_line import DATA, RESULTS
from benchmarks.costs.timing import machine
from benchmarks.costs.worker_start import processor_seconds
from benchmarks.sequences import choose, find_recordings
from common.errors import InputError
from common.settings import Settings, preset
from coordinator.bodies.choice import choose_bodies
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.sources import open_source
from coordinator.tracking.pipeline import follow
from coordinator.tracking.single import SingleTracker as Tracker

SEQUENCES = ("a8_s1", "a14_s2", "a21_s1", "a27_s2")
WORKERS = (2, 1)
POINTS = 5_000
SETTLED = 4  # frames that do not count: a start is sought in the first
RESULT = RESULTS / "video_rate.json"

Spent = tuple[float, list[float], float, float]


def main() -> int:
    """Measure, print, keep the numbers."""
    parser = argparse.ArgumentParser("python -m benchmarks.costs.video_rate", description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RESULT, metavar="FILE")
    chosen = parser.parse_args()
    try:
        recordings = choose(find_recordings(chosen.data), SEQUENCES)
    except InputError as error:
        sys.stderr.write(f"video_rate: {error}\n")
        return 0
    settings = msgspec.structs.replace(preset("default"), points=POINTS)
    runs = [
        {"sequence": recording.name, "workers": workers, **run(recording.depth, settings, workers)}
        for _ in range(chosen.rounds)
        for recording in recordings
        for workers in WORKERS
    ]
    result = {"machine": machine("eclipse-zenoh", "numpy"), "points": POINTS, "runs": runs}
    chosen.out.write_text(json.dumps(result, indent=2) + "\n")
    sys.stdout.write("\n".join(map(tell, runs)) + "\n")
    return 0


def run(depth: Path, settings: Settings, workers: int) -> dict[str, Any]:
    """Milliseconds a frame, by stage and of whose processor, and what others took of the machine."""
    source = open_source(depth)
    frames = [source.frame(number) for number in source.numbers]
    laps, stages = [], []
    with ZenohRefiner(Pool(workers=workers)) as refiner:
        refiner.wait_for(workers)
        tracker = Tracker(refiner, settings, choose_bodies(None, settings.preset))
        at: list[Spent] = []  # settled, and after the last frame
        for estimate, _ in follow(tracker, frames):
            laps.append(time.perf_counter())
            stages.append(estimate.stage_seconds)
            if len(laps) - 1 in (SETTLED, len(frames) - 1):
                at.append(spent(refiner))
        before, after = at
    count = len(frames) - 1 - SETTLED
    spans = 1e3 * np.diff(laps)[SETTLED:]
    return {
        "frames_per_second": 1e3 / float(spans.mean()),
        "ms": float(np.median(spans)),
        "stages_ms": {
            stage: 1e3 * float(np.median([each.get(stage, 0.0) for each in stages[SETTLED + 1 :]]))
            for stage in stages[-1]
        },
        "coordinator_processor_ms": 1e3 * (after[0] - before[0]) / count,
        "worker_processor_ms": [1e3 * (b - a) / count for a, b in zip(before[1], after[1], strict=True)],
        "stolen_percent": 100.0 * (after[2] - before[2]) / max(after[3] - before[3], 1e-9),
    }


def spent(refiner: ZenohRefiner) -> Spent:
    """Seconds of the coordinator's processor, of each worker's, stolen from all, and of all, so far."""
    ticks = [int(word) for word in Path("/proc/stat").read_text(encoding="utf-8").split()[1:9]]
    workers = [processor_seconds(pid) for pid in refiner.local_pids.values()]
    return time.process_time(), workers, float(ticks[7]), float(sum(ticks))


def tell(run: dict[str, Any]) -> str:
    """A run as a line."""
    workers = ", ".join(f"{ms:.1f}" for ms in run["worker_processor_ms"])
    return (
        f"{run['sequence']:8} {run['workers']} workers {run['frames_per_second']:5.1f} frames/s, "
        f"{run['ms']:5.1f} ms (median); processor: coordinator {run['coordinator_processor_ms']:.1f} ms, "
        f"workers {workers} ms; stolen {run['stolen_percent']:.1f} %"
    )


if __name__ == "__main__":
    sys.exit(main())
