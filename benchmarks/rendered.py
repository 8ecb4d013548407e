"""The filter and single particles on rendered people who move fast: python -m benchmarks.rendered.

`gepf demo` compares the filter with the best single particle; this benchmark shows which one that is. Each
seed is another person and another motion (`gepf synth person`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.people import Row, Trial, run_trials
from benchmarks.recordings import Recording
from benchmarks.running import add_processes, command_line, keep, measured
from benchmarks.tracking import near_percent
from gepf.common.arrays import Array
from gepf.coordinator.files import TRUTH_FILE
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.synthesis.sequence import PERSON, synthesise

ROWS = (
    Row("gepf, 20 particles"),
    Row("one particle, looked for again", ("icp_iterations=6", "points=10000"), 1),
    Row("one particle (--method gradient)", ("method=gradient",)),
    Row("one particle, preset paper", ("preset=paper", "method=gradient")),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, track, print a line for each row."""
    parser = command_line("rendered", __doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=[10, 20], metavar=("A", "B"))
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a sequence crashed."""
    with TemporaryDirectory() as folder:
        recordings = [render(Path(folder) / str(seed), seed) for seed in range(*chosen.seeds)]
        trials = [Trial(row, 1, 0, recording) for row in ROWS for recording in recordings]
        outcomes = run_trials(trials, chosen.processes)
    lines = [f"{'':34}{'cm':>8}{'<10 cm':>8}{'worst':>8}{'a joint off':>14}"]
    for row in ROWS:
        errors = [one.distances(raw=True) for trial, one in outcomes.items() if trial.row is row]
        lines.append(f"{row.name:34}{describe(errors)}")
    print("\n".join(lines))
    keep(lines, chosen.out)
    return int(len(outcomes) < len(trials))


def render(folder: Path, seed: int) -> Recording:
    """A person of 60 frames at 10 a second, with a Kinect's noise and the truth."""
    synthesise(PERSON, folder, seed=seed, kinect=True)
    return Recording(str(seed), folder, folder / TRUTH_FILE)


def describe(errors: Sequence[Array]) -> str:
    """Mean error, share within 10 cm and its worst sequence, share of frames with a joint off by 15 cm."""
    near = [near_percent(one) for one in errors]
    off = [100.0 * np.mean(np.max(one, axis=1) > CertaintySettings().wrong_m) for one in errors]
    centimetres = 100.0 * np.mean([np.nanmean(one) for one in errors])
    return f"{centimetres:8.1f}{np.mean(near):8.1f}{min(near):8.1f}{np.mean(off):14.1f}"


if __name__ == "__main__":
    sys.exit(main())
