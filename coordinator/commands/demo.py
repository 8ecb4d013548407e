"""`gepf demo`: rendered sequences, tracked by the filter and by a single particle.

People who move fast, at ten frames per second: their limbs hide each other and move far between frames, so a
single pose often converges to a wrong mode. The single particle has twice the iterations, more than twice the
points, and redetection when in doubt. `python -m benchmarks.rendered` has other variants.

The other scene is the sequence of section 5 of the paper, an arm with heavy noise, which gradient tracking
loses: noise of 15 cm in depth and 1 cm laterally, with an initial error of 50 degrees in one shoulder angle.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection, Sequence
from pathlib import Path

import msgspec
import numpy as np
from rich.table import Table

from gepf.common.errors import GepfError, InputError, check_choice
from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.many import run_pool
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.files import FILM_FILE, TRUTH_FILE
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.evaluation import THRESHOLDS, measure_errors, overall, read_truth
from gepf.coordinator.results.track import read_track
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.settings import Settings
from gepf.coordinator.synthesis.scenes import ARM_DOFS
from gepf.coordinator.synthesis.sequence import PERSON, synthesise

ARM = "arm"
LANES = Pool(2)
SEEDS = {PERSON: range(4), ARM: range(1)}
SEQUENCE, LONE, FILTER = "sequence", "one-particle", "gepf"
NOISE = SensorNoise(depth=0.15, lateral=0.01)  # metres, of the arm
MARKER = ".gepf-demo"  # in the output folder: the names of the folders that the demo made, one per line
CELLS = {
    PERSON: ("joints within 10 cm (mean error)", "{:.1f} % ({:.1f} cm)"),
    ARM: ("error of the angles (best hypothesis)", "{:.1f}\N{DEGREE SIGN} ({:.1f}\N{DEGREE SIGN})"),
}


def run_demo(
    out: Path | None,
    show: Show,
    scene: str = PERSON,
    pool: Pool = LANES,
    seeds: Sequence[int] = (),
    frames: int | None = None,
) -> None:
    """Render a scene once per seed, track it with one particle and with the filter, and show a table.

    The folders of sequences and runs in `out` replace those of an earlier demo. Raises InputError if `out`
    holds anything that no demo made, or for an unknown scene.
    """
    check_choice("scene", scene, SEEDS)
    out, seeds = out or Path("gepf-demo"), seeds or SEEDS[scene]
    is_arm = scene == ARM
    ways = {FILTER: settings_for("gepf"), LONE: settings_for("gradient") if is_arm else lone_settings()}
    make_room(out, [f"{kind}-{seed}" for seed in seeds for kind in (SEQUENCE, *ways)])
    depth, lateral = (NOISE.depth, NOISE.lateral) if is_arm else (None, None)
    with show.steps(f"rendering {scene}") as advance:
        for k, seed in enumerate(seeds):
            synthesise(scene, out / f"{SEQUENCE}-{seed}", frames, depth, lateral, seed, kinect=not is_arm)
            advance(k + 1, len(seeds))
    active = ARM_DOFS if is_arm else None
    jobs = [
        # pictures only of the first, because they take longest
        Job(out / f"{SEQUENCE}-{seed}", out / f"{way}-{seed}", settings, pool, active=active, pictures=k == 0)
        for k, seed in enumerate(seeds)
        for way, settings in ways.items()
    ]
    show.say(f"tracking {len(jobs)} runs; the first time, compiling takes a few minutes")
    for run in run_pool(jobs, show, quiet=True):
        if not run.is_done:
            raise GepfError(f"tracking into {run.job.folder} failed (exit code {run.code}); see above")
    scores = np.array([[score(scene, out, way, seed) for way in (LONE, FILTER)] for seed in seeds])
    show.console.print(tabulate(scene, scores))
    drawn = [out / f"{way}-{seeds[0]}" / FILM_FILE for way in (FILTER, LONE)]
    show.say(f"look at {drawn[0]} and {drawn[1]}")


def make_room(out: Path, folders: Collection[str]) -> None:
    """Remove the folders of an earlier demo from `out`, and note in `out` the folders of this demo.

    Nothing else is removed: InputError if `out` is not empty and no demo made it, or if one of `folders`
    exists and no demo made it.
    """
    marker = out / MARKER
    try:
        held = {path.name for path in out.iterdir()} if out.exists() else set()
        made = set(marker.read_text(encoding="utf-8").splitlines()) if MARKER in held else set()
        foreign = sorted(held & set(folders) - made if MARKER in held else held)
        if foreign:
            raise InputError(f"'{out / foreign[0]}' was not made by gepf demo; choose another --out")
        for name in held & made:
            shutil.rmtree(out / name)
        out.mkdir(parents=True, exist_ok=True)
        marker.write_text("".join(f"{name}\n" for name in folders), encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"cannot write to '{out}' ({reason}); choose another --out") from error


def lone_settings() -> Settings:
    """Settings of the best single particle: the filter with points and iterations of method gradient."""
    lone = settings_for("gradient")
    settings = settings_for("gepf", particles=1, points=lone.points)
    refine = msgspec.structs.replace(settings.refine, icp_iterations=lone.refine.icp_iterations)
    return msgspec.structs.replace(settings, refine=refine)


def score(scene: str, out: Path, way: str, seed: int) -> tuple[float, float]:
    """For people, the percentage of joints within 10 cm (0 if nobody was detected) and the mean error, cm.

    For the arm, the mean error of the angles and that of the best hypothesis, degrees.
    """
    truth = read_truth(out / f"{SEQUENCE}-{seed}" / TRUTH_FILE)
    errors = measure_errors(read_track(out / f"{way}-{seed}"), truth)
    if scene == ARM:
        return float(np.nanmean(errors.angle_deg)), float(np.nanmean(errors.best_angle_deg))
    mean_m = overall(errors.joint_m)
    near = 100.0 * float((errors.joint_m <= THRESHOLDS.near_m).mean())
    return near, np.nan if mean_m is None else 100.0 * mean_m


def tabulate(scene: str, scores: np.ndarray) -> Table:
    """One row per sequence with the scores (S, 2, 2) of both methods, and one row with the mean."""
    title, form = CELLS[scene]
    table = Table(title, "one particle", "gepf, 20 particles", box=None)
    rows = {f"{scene} {k}": row for k, row in enumerate(scores)} | {"mean": scores.mean(axis=0)}
    for name, row in rows.items():
        table.add_row(name, *(form.format(*pair) for pair in row))
    return table
