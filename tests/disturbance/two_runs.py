"""Two runs at once on one pool of two workers, beside each alone: `python -m tests.disturbance.two_runs`.

Both must end with the bytes of their lone runs. A fair pool makes each about twice as slow; how much slower
they are is printed, as one JSON object. Rounds alternate, so that what else the machine does hits both alike.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path

from tests.support.processes.warm_processes import Workers, coordinate, start
from tests.support.small_sequence import write_small_sequence

FRAMES = 100
ROUNDS = 3
PARTICLES = "40"
SEEDS = ("1", "2")  # of the two runs


class Pool:
    """Two workers that are linked to both coordinators."""

    def __init__(self, folder: Path, frames: int) -> None:
        self.folder = folder
        self.endpoints = tuple(f"unixsock-stream/{folder / seed}.sock" for seed in SEEDS)
        write_small_sequence(folder / "sequence", frames)

    def track(self, place: Path, which: tuple[int, ...]) -> list[float]:
        """Runs at the same time; gives the seconds that each took from its first frame to its last."""
        runs = [
            start(
                coordinate,
                self.folder / "sequence",
                place / SEEDS[k],
                self.endpoints[k],
                *("--seed", SEEDS[k], "--particles", PARTICLES),
                log=self.folder / "log.txt",
            )
            for k in which
        ]
        for run in runs:
            run.join()
        if any(run.exitcode for run in runs):
            raise SystemExit((self.folder / "log.txt").read_text())
        summaries = [json.loads((place / SEEDS[k] / "summary.json").read_text()) for k in which]
        return [(summary["frames"] - 1) / summary["frame_rate"] for summary in summaries]


def compare(frames: int, rounds: int) -> dict[str, object]:
    """Alone, alone, both together; as many times."""
    lone: list[list[float]] = []
    shared: list[list[float]] = []
    with tempfile.TemporaryDirectory(prefix="gepf-runs-") as name:
        folder = Path(name)
        pool = Pool(folder, frames)
        with Workers(pool.endpoints, folder / "workers.txt") as workers:
            workers.start("a")
            workers.start("b")
            for k in range(rounds):
                lone.append([pool.track(folder / f"lone{k}", (which,))[0] for which in (0, 1)])
                shared.append(pool.track(folder / f"shared{k}", (0, 1)))
        tracks = [
            [path.read_bytes() for path in sorted(folder.glob(f"*/{seed}/track.npz"))] for seed in SEEDS
        ]
    slower = [[b / a for a, b in zip(*pair, strict=True)] for pair in zip(lone, shared, strict=True)]
    return {
        "identical": all(len(each) == 2 * rounds and len(set(each)) == 1 for each in tracks),
        "lone_seconds": lone,
        "shared_seconds": shared,
        "slower": slower,
        "slower_median": [statistics.median(column) for column in zip(*slower, strict=True)],
    }


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Two runs on one pool, beside each alone.")
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    options = parser.parse_args()
    result = compare(options.frames, options.rounds)
    sys.stdout.write(json.dumps(result, indent=2) + "\n")
    return 0 if result["identical"] else 1


if __name__ == "__main__":
    sys.exit(main())
