"""Tracked angular speeds compared with an instrument: python -m benchmarks.gyroscope.

The people of UTD-MHAD wore a gyroscope, 50 samples per second, on the right wrist (actions 1 to 21) or the
right thigh (22 to 27). Its angular speed is compared with that of the direction of the tracked forearm or
thigh, and with that of the camera vendor's skeleton in the same frames. The clocks are not aligned: of each
comparison, the lag with the highest correlation counts. A gyroscope also measures rotation about the axis of
the limb, so no method reaches a correlation of 1. Progress on stderr, a table on stdout, numbers in a JSON
file. Exit code 1 if a recording crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import msgspec
import numpy as np
import scipy.io
from rich.table import Table

from benchmarks.people import DEFAULT, Trial, run_trials
from benchmarks.recordings import JOINTS, Recording, choose, find_people
from benchmarks.running import add_changes, add_data, add_processes, command_line, keep, measured, screen
from benchmarks.tracking import Outcome
from gepf.common.arrays import Array
from gepf.common.errors import InputError

GYROSCOPE_HZ = 50.0
SMOOTHED_S = 0.17  # moving average of both speeds: three frames
LAGS_S = np.arange(-1.2, 1.21, 0.02)
OVERLAP = 0.75  # least share of the frames within the gyroscope's samples
LAST_ARM_ACTION = 21
FOREARM, THIGH = ("left_elbow", "left_wrist"), ("left_hip", "left_knee")
"""The limbs with the gyroscope. The images are mirrored, so the person's right limb is our left one."""


class Agreement(msgspec.Struct, frozen=True):
    """How well an angular speed agrees with the gyroscope's."""

    correlation: float
    rms: float  # degrees per second
    lag_s: float  # of the gyroscope's clock


class Comparison(msgspec.Struct, frozen=True):
    """One tracked recording and the vendor's skeleton in the same frames."""

    recording: str
    seed: int
    tracked: Agreement
    vendor: Agreement


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the numbers."""
    parser = command_line("gyroscope", __doc__)
    add = parser.add_argument
    add_data(parser)
    add("--only", nargs="+", metavar="NAME", help="recordings (a14_s2), actions (a14), or: hard")
    add("--subjects", nargs="+", type=int, default=[3, 4], metavar="S")
    add("--seeds", type=int, default=1, metavar="N")
    add_changes(parser)
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    recordings = choose(find_people(chosen.data, chosen.subjects), chosen.only)
    speeds = {recording: read_gyroscope(recording) for recording in recordings}
    trials = [Trial(DEFAULT, 1, seed, recording) for seed in range(chosen.seeds) for recording in recordings]
    outcomes = run_trials(trials, chosen.processes, chosen.changes)
    found = [compare(trial.seed, outcome, speeds[trial.recording]) for trial, outcome in outcomes.items()]
    screen().print(table(found))
    keep(found, chosen.out)
    return int(len(outcomes) < len(trials))


def read_gyroscope(recording: Recording) -> Array:
    """Angular speeds (N,) of a recording's gyroscope, radians per second; InputError if there is no file."""
    path = recording.depth.parent.parent / "inertial" / f"{recording.name}_t1_inertial.mat"
    if not path.is_file():
        raise InputError(f"{path} is missing; copy the folder of inertial data beside depth/ and skeleton/")
    rates = scipy.io.loadmat(path)["d_iner"][:, 3:]  # after three accelerations; degrees per second
    return np.asarray(np.radians(np.linalg.norm(rates, axis=1)))


def compare(seed: int, outcome: Outcome, gyroscope: Array) -> Comparison:
    """The agreement of a tracked recording, and of its reference, with the gyroscope's speeds (N,)."""
    action = outcome.recording.action
    upper, lower = map(JOINTS.index, FOREARM if action and action <= LAST_ARM_ACTION else THIGH)
    tracked, vendor = (
        agree(angular_speed(joints[:, lower] - joints[:, upper], outcome.fps), outcome.fps, gyroscope)
        for joints in (outcome.joints, outcome.reference)
    )
    return Comparison(outcome.recording.name, seed, tracked, vendor)


def angular_speed(bones: Array, fps: float) -> Array:
    """Speeds (F - 1,) at which the direction of a bone (F, 3) turns between frames, radians per second."""
    units = bones / np.linalg.norm(bones, axis=1, keepdims=True)
    between = np.clip(np.sum(units[1:] * units[:-1], axis=1), -1.0, 1.0)
    return np.asarray(fps * np.arccos(between))


def agree(speeds: Array, fps: float, gyroscope: Array) -> Agreement:
    """Agreement of speeds (F - 1,) between frames with a gyroscope's (N,), at the best lag.

    Frames without a pose (NaN) do not count.
    """
    slow = moving_average(speeds, fps)
    exact = moving_average(gyroscope, GYROSCOPE_HZ)
    times = (np.arange(len(slow)) + 0.5) / fps
    best = Agreement(-1.0, float("nan"), 0.0)
    for lag in LAGS_S:
        at = (times + lag) * GYROSCOPE_HZ
        both = (at >= 0.0) & (at <= len(exact) - 1) & np.isfinite(slow)
        if both.sum() < OVERLAP * len(slow):
            continue
        measured = np.interp(at[both], np.arange(len(exact)), exact)
        correlation = float(np.corrcoef(measured, slow[both])[0, 1])
        if correlation > best.correlation:
            rms = float(np.degrees(np.sqrt(np.mean((measured - slow[both]) ** 2))))
            best = Agreement(correlation, rms, round(float(lag), 2))
    return best


def moving_average(values: Array, rate: float) -> Array:
    """Values (N,) at a rate per second, averaged over SMOOTHED_S, by an odd number of them."""
    window = np.ones(2 * round(0.5 * (SMOOTHED_S * rate - 1.0)) + 1)
    sums, counts = (np.convolve(each, window, "same") for each in (values, np.ones(len(values))))
    return np.asarray(sums / counts)


def table(found: Sequence[Comparison]) -> Table:
    """A line for the tracked limbs and one for the vendor's."""
    shown = Table(title=f"Angular speeds beside the gyroscope's, {len(found)} comparisons")
    for heading in ("limb of", "correlation", "above 0.8", "rms, degrees/s"):
        shown.add_column(heading, justify="left" if heading == "limb of" else "right")
    for name, those in (
        ("gepf", [one.tracked for one in found]),
        ("the vendor", [one.vendor for one in found]),
    ):
        correlations = np.array([one.correlation for one in those])
        shown.add_row(
            name,
            f"{np.median(correlations):.3f}",
            f"{100.0 * np.mean(correlations > 0.8):.0f} %",
            f"{np.median([one.rms for one in those]):.1f}",
        )
    return shown


if __name__ == "__main__":
    sys.exit(main())
