"""The paper's arm behind heavy noise, which gradient tracking loses.

The sequence is that of section 5 of the paper, noise of 15 cm in depth and 1 cm across, started 50
degrees off in one shoulder angle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coordinator.commands.console.progress import Show
from coordinator.commands.options.choices import choose_settings
from coordinator.commands.options.job import Job
from coordinator.commands.track import track_sequence
from coordinator.commands.workers import Connect, PooledRefiner, connect_workers
from coordinator.files import TRUTH_FILE
from coordinator.pool.options import Pool
from coordinator.results.evaluation import Errors, compare, lost_from, read_truth
from coordinator.results.track import read_track
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.synthesis.sequence import synthesise
from coordinator.tracking.observing.sensor_noise import SensorNoise

NOISE = SensorNoise(depth=0.15, lateral=0.01)
FRAMES = 110
SETTLED = 30  # frames that the table leaves out: tracking starts with a wrong pose
COMPARED = {"gradient": None, "gepf": 20}  # particles
SEQUENCE = "sequence"


def demo_arm(
    out: Path,
    show: Show,
    pool: Pool,
    connect: Connect[PooledRefiner] = connect_workers,
    frames: int = FRAMES,
) -> None:
    """Make the sequence in `out`, track it with each method into a folder of its own, and show the table."""
    with show.steps("rendering the sequence") as advance:
        synthesise("arm", out / SEQUENCE, frames, NOISE.depth, NOISE.lateral, advance=advance)
    for method, particles in COMPARED.items():
        show.say(f"tracking with {method}")
        settings = choose_settings(method, "default", particles, None, seed=0)
        job = Job(out / SEQUENCE, out / method, settings, pool, active=ARM_DOFS)
        track_sequence(job, show, connect)
    for line in tabulate({method: errors_of(out, method) for method in COMPARED}):
        show.say(line)
    show.say(f"look at {out / 'gepf' / 'overlay.gif'} and the other pictures beside it")


def errors_of(out: Path, method: str) -> Errors:
    """Errors of a method's run."""
    return compare(read_track(out / method), read_truth(out / SEQUENCE / TRUTH_FILE))


def tabulate(errors: dict[str, Errors]) -> list[str]:
    """Lines of a table: mean absolute error of each angle, by method, reported and best hypothesis."""
    columns = {
        "gradient": errors["gradient"].angle_deg,
        "gepf": errors["gepf"].angle_deg,
        "gepf, best hypothesis": errors["gepf"].best_angle_deg,
    }
    names = errors["gepf"].dof_names
    settled = min(SETTLED, len(errors["gepf"].frame) // 2)
    rows = [
        justify(name, [f"{value:.1f}" for value in row], list(columns))
        for name, row in mean_rows(names, list(columns.values()), settled)
    ]
    lost = [f"{method}: {describe_lost(lost_from(found))}" for method, found in errors.items()]
    heading = f"mean absolute error in degrees from frame {settled} on, noise of 15 cm in depth"
    return [heading, justify("", list(columns), list(columns)), *rows, "; ".join(lost)]


def justify(name: str, cells: list[str], heads: list[str]) -> str:
    """A line with the name to the left and cells under their heads to the right."""
    return f"{name:<20}" + "".join(
        f"  {cell:>{max(6, len(head))}}" for cell, head in zip(cells, heads, strict=True)
    )


def mean_rows(
    names: tuple[str, ...], columns: list[NDArray[np.float64]], settled: int
) -> list[tuple[str, list[float]]]:
    """Mean of each angle, and of all, for every column (F, A)."""
    means = np.array([np.nanmean(column[settled:], axis=0) for column in columns])  # (C, A)
    rows = [(name, means[:, a].tolist()) for a, name in enumerate(names)]
    return [*rows, ("mean", means.mean(axis=1).tolist())]


def describe_lost(frame: int | None) -> str:
    """When tracking was lost, in words."""
    return "not lost" if frame is None else f"lost from frame {frame} on"
