"""The paper's arm behind heavy noise, which gradient tracking loses.

The sequence is that of section 5 of the paper, noise of 15 cm in depth and 1 cm across, started 50
degrees off in one shoulder angle.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from coordinator.commands.job import Job, choose_settings
from coordinator.commands.progress import Show
from coordinator.commands.track import track
from coordinator.commands.workers import Connect, connect_workers
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
    connect: Connect = connect_workers,
    frames: int = FRAMES,
) -> None:
    """Make the sequence in `out`, track it with each method into a folder of its own, and show the table."""
    with show.steps("rendering the sequence") as advance:
        synthesise("arm", out / SEQUENCE, frames, NOISE.depth, NOISE.lateral, advance=advance)
    for method, particles in COMPARED.items():
        show.say(f"tracking with {method}")
        settings = choose_settings(method, "default", particles, None, seed=0)
        job = Job(out / SEQUENCE, out / method, settings, pool, active=ARM_DOFS)
        track(job, show, connect)
    truth = read_truth(out / SEQUENCE / TRUTH_FILE)
    for line in tabulate({method: compare(read_track(out / method), truth) for method in COMPARED}):
        show.say(line)
    show.say(f"look at {out / 'gepf' / 'overlay.gif'} and the other pictures beside it")


def tabulate(errors: dict[str, Errors]) -> list[str]:
    """Lines of a table: mean absolute error of each angle, by method, reported and best hypothesis."""
    columns = {
        "gradient": errors["gradient"].angle_deg,
        "gepf": errors["gepf"].angle_deg,
        "gepf, best hypothesis": errors["gepf"].best_angle_deg,
    }
    settled = min(SETTLED, len(errors["gepf"].frame) // 2)
    means = np.array([np.nanmean(column[settled:], axis=0) for column in columns.values()])  # (C, A)
    named = dict(zip(errors["gepf"].dof_names, means.T, strict=True)) | {"mean": means.mean(axis=1)}
    widths = [max(6, len(head)) for head in columns]

    def justify(name: str, cells: Iterable[str]) -> str:
        """A line with the name to the left and cells under their heads to the right."""
        return f"{name:<20}" + "".join(
            f"  {cell:>{width}}" for cell, width in zip(cells, widths, strict=True)
        )

    lost = [
        f"{method}: {'not lost' if frame is None else f'lost from frame {frame} on'}"
        for method, frame in ((method, lost_from(found)) for method, found in errors.items())
    ]
    heading = f"mean absolute error in degrees from frame {settled} on, noise of 15 cm in depth"
    rows = [justify(name, [f"{value:.1f}" for value in values]) for name, values in named.items()]
    return [heading, justify("", columns), *rows, "; ".join(lost)]
