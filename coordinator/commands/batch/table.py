"""Several runs as one table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common.errors import InputError
from coordinator.commands.finished.own_truth import own_truth
from coordinator.commands.options.job import Job
from coordinator.results.evaluation import evaluate
from coordinator.results.summary import read_summary
from coordinator.results.track import read_track

HEADS = ("recording", "frames", "tracked", "seconds", "joint error", "")
UNKNOWN = "-"


def tabulate(runs: Sequence[tuple[Job, int, str, float]]) -> list[str]:
    """Lines of a table: name, frames, share that is tracked, seconds, joint error where a truth is there."""
    rows = [HEADS, *(row(job, code, line, seconds) for job, code, line, seconds in runs)]
    widths = [max(len(row[c]) for row in rows) for c in range(len(HEADS))]
    return [justify(cells, widths) for cells in rows]


def justify(cells: Sequence[str], widths: Sequence[int]) -> str:
    """The first and last cell to the left, numbers between them to the right."""
    first, *numbers, last = cells
    middle = "  ".join(cell.rjust(width) for cell, width in zip(numbers, widths[1:-1], strict=True))
    return f"{first.ljust(widths[0])}  {middle}  {last}".rstrip()


def row(job: Job, code: int, line: str, seconds: float) -> tuple[str, ...]:
    """One run's cells; of one that left no results, why."""
    name, took = job.out.name, f"{seconds:.1f}"
    if code:
        return (name, UNKNOWN, UNKNOWN, took, UNKNOWN, f"exit code {code}: {line}")
    summary = read_summary(job.out)
    frames, status = summary["frames"], summary["status"]
    tracked = f"{100 * status.get('tracked', 0) / max(frames, 1):.0f} %"
    return (name, str(frames), tracked, took, joint_error(job.out), "")


def joint_error(run: Path) -> str:
    """Mean joint error in centimetres, where the sequence comes with its truth."""
    truth = own_truth(run)
    if truth is None:
        return UNKNOWN
    try:
        error = evaluate(read_track(run), truth).mean_joint_error_cm
    except InputError:
        return UNKNOWN
    return UNKNOWN if error is None else f"{error:.1f} cm"
