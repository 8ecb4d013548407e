"""How many particles the frames of recordings use: python -m benchmarks.particles RECORDING [...].

Each recording is tracked with every frame and with every third; the picture shows the particles over time.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.running import command_line, keep, measured
from benchmarks.tracking import bodies_of, follow, prepare
from gepf.coordinator.settings import preset
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.source import rate_of
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

EVERY = (1, 3)  # n-th frame


def main() -> int:
    """Track, print the mean number of each row, draw."""
    parser = command_line("particles", __doc__)
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING")
    parser.add_argument("--picture", type=Path, default=Path("docs/particles.png"), metavar="FILE")
    return measured(measure, parser.parse_args())


def measure(chosen: argparse.Namespace) -> int:
    """Exit code 0."""
    prepare()
    used: dict[str, list[int]] = {}
    figure = Figure((10.0, 2.2 * len(chosen.recordings)), layout="constrained")
    rows = figure.subplots(len(chosen.recordings), 1, squeeze=False)[:, 0]
    for row, path in zip(rows, chosen.recordings, strict=True):
        for every in EVERY:
            frames = list(open_source(path))[::every]
            times = np.array([frame.time_s for frame in frames])
            found, _ = follow(Tracker(DirectRefiner(), preset("default"), bodies_of("default")), frames)
            count = [each.estimate.particles for each in found]
            name = f"{path.stem.removesuffix('_depth')}, {rate_of(times):.1f} frames/s"
            used[name] = count
            print(f"{name}: {np.mean(count):.1f} particles")
            row.step(times - times[0], count, label=name, where="mid")
        row.set(ylabel="particles", ylim=(0.0, 22.0))
        row.legend(loc="lower right")
    rows[-1].set_xlabel("seconds")
    figure.savefig(chosen.picture, dpi=90)
    keep(used, chosen.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
