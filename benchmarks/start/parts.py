"""The parts of the measurement, and their tables."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.start.cases import Case, Footage, all_starts, gaps, read_real, read_skinned, situations
from benchmarks.start.measure import Outcome, count, play
from benchmarks.start.pitched import pitched_cases
from benchmarks.tracking import prepare
from coordinator.bodies.tracked import Bodies

CAMERAS = ("dance_cam0", "dance_cam100", "dance_cam220")
ACTIONS = range(1, 28)
WIDTH = 150


def run_parts(data: Path, parts: Sequence[str], subjects: Sequence[int]) -> None:
    """Measure and print."""
    bodies, console = prepare(), Console(width=None if sys.stdout.isatty() else WIDTH)
    rendered = [read_skinned(data / "three_cameras" / name) for name in CAMERAS]
    rendered += [read_skinned(data / "skinned" / name) for name in ("dance", "turn")]
    made: dict[str, Callable[[], list[Case]]] = {
        "starts": lambda: all_starts(rendered),
        "gaps": lambda: [case for footage in rendered for case in gaps(footage)],
        "real": lambda: all_starts(real(data, subjects)),
        "situations": lambda: [
            *situations(data, rendered[-2], rendered[-1]),
            *pitched_cases([data / "three_cameras" / name for name in CAMERAS], 30),
        ],
    }
    for part in parts:
        outcomes = play_all(made[part](), bodies)
        console.print(table_of_each(outcomes) if part == "situations" else table_of_all(part, outcomes))


def real(data: Path, subjects: Sequence[int]) -> list[Footage]:
    """All recordings of these people."""
    return [read_real(data, action, subject) for action in ACTIONS for subject in subjects]


def play_all(cases: Sequence[Case], bodies: Bodies) -> list[Outcome]:
    """Track all cases; a line for those that end wrong, or deceive."""
    outcomes = []
    for case in cases:
        outcome = play(case, bodies)
        outcomes.append(outcome)
        if case.joints and not outcome.ends_right:
            sys.stderr.write(
                f"{case.name}: {outcome.status[-1]}, {outcome.error_cm:.0f} cm off; {outcome.why}\n"
            )
    return outcomes


def table_of_all(part: str, outcomes: Sequence[Outcome]) -> Table:
    """One line for many starts."""
    known = [outcome for outcome in outcomes if outcome.right[-1] is not None]
    right = sum(outcome.ends_right for outcome in known)
    wrong = [outcome for outcome in known if not outcome.ends_right]
    frames = sum(len(outcome.status) for outcome in outcomes)
    seconds = [outcome.seconds for outcome in outcomes]
    table = Table(
        "starts", "right at the end", "wrong and called tracked", "frames so", "s of one core", title=part
    )
    table.add_row(
        str(len(known)),
        f"{right} ({100 * right / max(1, len(known)):.1f} %)",
        str(sum(outcome.status[-1] == "tracked" for outcome in wrong)),
        f"{sum(outcome.deceives for outcome in outcomes)} of {frames}",
        f"{np.median(seconds):.2f}, at most {max(seconds):.2f}",
    )
    return table


def table_of_each(outcomes: Sequence[Outcome]) -> Table:
    """A line for each situation."""
    table = Table(
        "situation", "frames", "wrong and called tracked", "last", "what is said", title="situations"
    )
    for outcome in outcomes:
        frames = ", ".join(f"{n} {status}" for status, n in count([outcome]).items())
        share = 100.0 * outcome.deceives / len(outcome.status)
        error = "" if np.isnan(outcome.error_cm) else f"{outcome.error_cm:.1f} cm"
        table.add_row(outcome.name, frames, f"{share:.0f} %", error, outcome.why)
    return table
