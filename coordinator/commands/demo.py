"""`gepf demo`: people who move fast, at ten frames per second; the filter and the best single particle.

Several people with different motions are rendered as depth images of a Kinect. Their limbs hide each other
and move far between frames, so a single pose often converges to a wrong mode. The single particle has twice
the iterations, more than twice the points, and redetection when in doubt. `python -m benchmarks.rendered` has
other variants of tracking with one particle.

The other scene is the sequence of section 5 of the paper, an arm with heavy noise, which gradient tracking
loses: noise of 15 cm in depth and 1 cm laterally, with an initial error of 50 degrees in one shoulder angle.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np
from rich.table import Table

from common.errors import GepfError, InputError
from common.settings import Settings
from coordinator.commands.console import NOT_TRACKED
from coordinator.commands.job import Job
from coordinator.commands.many import run_pool
from coordinator.commands.progress import Show
from coordinator.commands.track import track
from coordinator.commands.workers import Connect, connect_workers
from coordinator.files import FILM_FILE, TRUTH_FILE
from coordinator.filters.methods import settings_for
from coordinator.pool.options import Pool
from coordinator.results.evaluation import NEAR_M, Evaluation, compare, evaluate, overall, read_truth
from coordinator.results.track import read_track
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.synthesis.sequence import PERSON, synthesise
from coordinator.tracking.sensor_noise import SensorNoise

SEEDS = range(4)
LONE, FILTER = "one-particle", "gepf"
NOISE = SensorNoise(depth=0.15, lateral=0.01)  # metres, of the arm
OURS = re.compile(r"(sequence|gradient|one-particle|gepf)(-\d+)?")


def run_demo(out: Path | None, show: Show, scene: str = "person") -> None:
    """Render a scene, track it with one particle and with the filter, and show a table of errors.

    `out` gets folders of sequences and of runs; an earlier demo is replaced. Raises InputError if `out` holds
    anything else, or for an unknown scene.
    """
    demos: dict[str, Callable[[Path, Show, Pool], None]] = {"person": demo_person, "arm": demo_arm}
    if scene not in demos:
        raise InputError(f"unknown scene '{scene}'; choose from {', '.join(demos)}")
    out = Path("gepf-demo") if out is None else out
    make_room(out)
    demos[scene](out, show, Pool(2))


def make_room(out: Path) -> None:
    """Remove an earlier demo from `out`; InputError if it holds anything else."""
    try:
        held = [path.name for path in out.iterdir()] if out.exists() else []
        if not all(OURS.fullmatch(name) for name in held):
            raise InputError(f"'{out}' contains files that are not from a demo; choose another --out")
        for name in held:
            shutil.rmtree(out / name)
    except OSError as error:
        raise InputError(f"cannot write to '{out}' ({error.strerror}); choose another --out") from error


def demo_person(
    out: Path, show: Show, pool: Pool, seeds: Sequence[int] = SEEDS, frames: int | None = None
) -> None:
    """Render the sequences into `out`, track each with both methods, and show the table."""
    with show.steps("rendering person") as advance:
        for k, seed in enumerate(seeds):
            synthesise(PERSON, out / f"sequence-{seed}", frames, seed=seed, kinect=True)
            advance(k + 1, len(seeds))
    ways = {FILTER: settings_for("gepf"), LONE: lone_settings()}
    jobs = [
        # pictures only of the first, because they take longest
        Job(out / f"sequence-{seed}", out / f"{way}-{seed}", settings, pool, pictures=seed == seeds[0])
        for seed in seeds
        for way, settings in ways.items()
    ]
    for run in run_pool(jobs, None, show, quiet=True):
        if run.code not in (0, NOT_TRACKED):
            raise GepfError(f"{run.job.out} ended with exit code {run.code}")
    scores = np.array([[score(out, way, seed) for way in (LONE, FILTER)] for seed in seeds])  # (S, 2, 2)
    show.console.print(tabulate(scores))
    lone, many = scores[..., 0].T
    show.say(
        f"gepf is better for {sum(many > lone)} of {len(seeds)} people, one particle for {sum(many < lone)}"
    )
    drawn = [out / f"{way}-{seeds[0]}" / FILM_FILE for way in (FILTER, LONE)]
    show.say(f"look at {drawn[0]} and {drawn[1]}")


def lone_settings() -> Settings:
    """Settings of the best single particle: the filter with points and iterations of method gradient."""
    lone = settings_for("gradient")
    settings = settings_for("gepf", particles=1, points=lone.points)
    refine = msgspec.structs.replace(settings.refine, icp_iterations=lone.refine.icp_iterations)
    return msgspec.structs.replace(settings, refine=refine)


def score(out: Path, way: str, seed: int) -> tuple[float, float]:
    """Percentage of joints within 10 cm (0 if nobody was detected), and the mean error, centimetres."""
    truth = read_truth(out / f"sequence-{seed}" / TRUTH_FILE)
    errors_m = compare(read_track(out / f"{way}-{seed}"), truth).joint_m
    mean_m = overall(errors_m)
    return 100.0 * float((errors_m <= NEAR_M).mean()), np.nan if mean_m is None else 100.0 * mean_m


def tabulate(scores: np.ndarray) -> Table:
    """One row per person with the scores (S, 2, 2) of both methods, and one with the mean."""
    table = Table("joints within 10 cm (mean error)", "one particle", "gepf, 20 particles", box=None)
    for name, row in [*((f"person {k}", row) for k, row in enumerate(scores)), ("mean", scores.mean(axis=0))]:
        table.add_row(name, *(f"{near:.1f} % ({mean:.1f} cm)" for near, mean in row))
    return table


def demo_arm(
    out: Path, show: Show, pool: Pool, connect: Connect = connect_workers, frames: int | None = None
) -> None:
    """Render the sequence into `out`, track it with each method, and show the table."""
    with show.steps("rendering frame") as advance:
        synthesise("arm", out / "sequence", frames, NOISE.depth, NOISE.lateral, advance=advance)
    truth, found = read_truth(out / "sequence" / TRUTH_FILE), dict[str, Evaluation]()
    for method in ("gradient", "gepf"):
        show.say(f"tracking with {method}")
        job = Job(out / "sequence", out / method, settings_for(method), pool, active=ARM_DOFS)
        track(job, show, connect)
        found[method] = evaluate(read_track(job.out), truth)
    show.console.print(tabulate_angles(found))
    for method, errors in found.items():
        lost = errors.lost_from_frame
        show.say(f"{method}: {'not lost' if lost is None else f'lost from frame {lost} on'}")
    show.say(f"look at {out / 'gepf' / FILM_FILE} and the other pictures beside it")


def tabulate_angles(found: dict[str, Evaluation]) -> Table:
    """Mean absolute error of each angle, by method, and of the best hypothesis of the filter."""
    gepf = found["gepf"]
    columns = {
        "gradient": (found["gradient"].mean_angle_error_deg_by_dof, found["gradient"].mean_angle_error_deg),
        "gepf": (gepf.mean_angle_error_deg_by_dof, gepf.mean_angle_error_deg),
        "gepf, best hypothesis": (
            gepf.best_hypothesis_angle_error_deg_by_dof,
            gepf.best_hypothesis_angle_error_deg,
        ),
    }
    table = Table("mean absolute error in degrees", *columns, box=None)
    named = [{**(by_dof or {}), "mean": mean or 0.0} for by_dof, mean in columns.values()]
    for name in named[0]:
        table.add_row(name, *(f"{each[name]:.1f}" for each in named))
    return table
