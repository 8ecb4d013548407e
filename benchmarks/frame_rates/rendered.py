"""Filter and single particles on rendered people who move fast: python -m benchmarks.frame_rates.rendered.

The demo compares the filter with the best single particle; here is which one that is. Each seed is another
person and motion (`gepf synth person`), so every row is deterministic but for the random numbers of the
filter, which have the same seed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.choices import settings_with
from benchmarks.forks import Crash, run_forked
from benchmarks.tracking import follow, prepare
from coordinator.bodies.choice import choose_bodies
from coordinator.results.evaluation import NEAR_M, positions, read_truth
from coordinator.sources import open_source
from coordinator.synthesis.sequence import PERSON, synthesise
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

LONE = ("icp_iterations=6", "points=10000")
ROWS: dict[str, tuple[tuple[str, ...], int | None]] = {
    "gepf, 20 particles": ((), None),
    "one particle, looked for again": (LONE, 1),
    "one particle (--method gradient)": (("method=gradient",), None),
    "one particle, preset paper": (("preset=paper", "method=gradient"), None),
    "the same, paced, with the camera's law": (
        ("preset=paper", "method=gradient", "pace_iterations=2", "sensor=camera"),
        None,
    ),
}
FAR_M = 0.15


@dataclass(frozen=True, slots=True)
class Trial:
    """One sequence, tracked in one way."""

    row: str
    sequence: Path


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, track, print a line for each row."""
    parser = argparse.ArgumentParser("python -m benchmarks.frame_rates.rendered", description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=[10, 20], metavar=("A", "B"))
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="N")
    chosen = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        sequences = list(render(Path(folder), range(*chosen.seeds)))
        prepare()
        trials = [Trial(row, sequence) for row in ROWS for sequence in sequences]
        errors: dict[str, list[NDArray[np.float64]]] = {row: [] for row in ROWS}
        for trial, found in run_forked(track, trials, chosen.processes):
            if isinstance(found, Crash):
                print(found.trace)
                return 1
            errors[trial.row].append(found)
    print(f"{'':34}{'cm':>8}{'<10 cm':>8}{'worst':>8}{'a joint off':>14}")
    for row, found_in in errors.items():
        print(f"{row:34}{describe(found_in)}")
    return 0


def render(folder: Path, seeds: range) -> Iterator[Path]:
    """The sequences."""
    for seed in seeds:
        synthesise(PERSON, folder / str(seed), seed=seed, kinect=True)
        yield folder / str(seed)


def track(trial: Trial) -> NDArray[np.float64]:
    """Errors (F, J) of all joints, metres."""
    changes, particles = ROWS[trial.row]
    settings, source = settings_with(changes, particles), open_source(trial.sequence)
    tracker = Tracker(DirectRefiner(), settings, choose_bodies(None, settings.preset))
    estimates, _ = follow(tracker, source)
    truth = read_truth(trial.sequence / "truth.npz")
    true = truth.joint_positions[:, positions(truth.joint_names, tracker.model.joint_names)]
    off: NDArray[np.float64] = np.array([e.joint_positions for e in estimates]) - true
    distances: NDArray[np.float64] = np.sqrt(np.sum(off**2, axis=-1))
    return distances


def describe(errors: Sequence[NDArray[np.float64]]) -> str:
    """Mean error, share within 10 cm and its worst sequence, share of frames with a joint 15 cm off."""
    near = [100.0 * np.mean(one <= NEAR_M) for one in errors]
    off = [100.0 * np.mean(np.max(one, axis=1) > FAR_M) for one in errors]
    centimetres = 100.0 * np.mean([np.nanmean(one) for one in errors])
    return f"{centimetres:8.1f}{np.mean(near):8.1f}{min(near):8.1f}{np.mean(off):14.1f}"


if __name__ == "__main__":
    sys.exit(main())
