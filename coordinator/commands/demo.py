"""`gepf demo`: people who move fast, at ten frames a second; the filter beside the best single particle.

Several people, each with a motion of their own, are rendered as a Kinect would see them. Their limbs hide
each other, and are elsewhere in the next frame: a pose that is followed alone ends in the wrong valley. One
particle gets all that helps it: twice the iterations, more than twice the points, and it is looked for
again where it is in doubt; `python -m benchmarks.rendered` has the other ways to track with one.

The other scene is the paper's arm behind heavy noise, which gradient tracking loses: the sequence of section
5 of the paper, noise of 15 cm in depth and 1 cm across, started 50 degrees off in one shoulder angle.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console

from common.errors import GepfError, InputError
from common.settings import Settings
from coordinator.commands.console import DONE, NOT_TRACKED, end_as_interrupted
from coordinator.commands.job import Job, choose_settings
from coordinator.commands.many import run_pool
from coordinator.commands.progress import Show
from coordinator.commands.track import track
from coordinator.commands.workers import Connect, connect_workers
from coordinator.files import FILM_FILE, TRUTH_FILE
from coordinator.filters.methods import LONE_POINTS
from coordinator.pool.options import Pool
from coordinator.results.evaluation import NEAR_M, Errors, compare, lost_from, overall, read_truth
from coordinator.results.track import read_track
from coordinator.synthesis.person_scene import FPS
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.synthesis.sequence import PERSON, synthesise
from coordinator.tracking.sensor_noise import SensorNoise

SEEDS = range(4)
FRAMES = 50  # of each, so that all takes little more than a minute on two cores
FAR_M = 0.15
LONE, FILTER = "one-particle", "gepf"
LONE_ITERATIONS = 6  # at 30 frames a second, as of method gradient
NOISE = SensorNoise(depth=0.15, lateral=0.01)  # metres, of the arm
ARM_FRAMES = 110
SETTLED = 30  # frames of the arm that its table leaves out: tracking starts with a wrong pose
COMPARED = {"gradient": None, "gepf": 20}  # particles
OURS = re.compile(r"(sequence|gradient|one-particle|gepf)(-\d+)?")


@dataclass(frozen=True, slots=True)
class Score:
    """One run: per cent of joints that are near, mean error, per cent of frames with a joint far off."""

    near_percent: float
    mean_cm: float
    off_percent: float


class BarAlone(Show):
    """Shows the bar of many runs, and none of what each has to say."""

    def __init__(self, show: Show) -> None:
        super().__init__(Console(quiet=True))
        self.steps = show.steps  # type: ignore[method-assign]


def run_demo(out: Path | None, show: Show, scene: str = "person") -> None:
    """Render a scene, track it with one particle and with the filter, and show a table of errors.

    `out` gets folders of sequences and of runs; an earlier demo there is replaced. Raises InputError if it
    holds anything else, or for an unknown scene.
    """
    demos: dict[str, Callable[[Path, Show, Pool], None]] = {"person": demo_person, "arm": demo_arm}
    if scene not in demos:
        raise InputError(f"unknown scene '{scene}'; choose from {', '.join(demos)}")
    end_as_interrupted()
    out = Path("gepf-demo") if out is None else out
    make_room(out)
    demos[scene](out, show, Pool(2))


def make_room(out: Path) -> None:
    """Remove an earlier demo from `out`; InputError if there is anything else."""
    try:
        held = [path.name for path in out.iterdir()] if out.exists() else []
        if not all(OURS.fullmatch(name) for name in held):
            raise InputError(f"'{out}' holds other things than a demo; choose another --out")
        for name in held:
            shutil.rmtree(out / name)
    except OSError as error:
        raise InputError(f"cannot write to '{out}' ({error.strerror}); choose another --out") from error


def demo_person(
    out: Path, show: Show, pool: Pool, seeds: Sequence[int] = SEEDS, frames: int = FRAMES
) -> None:
    """Make the sequences in `out`, track each in both ways into folders beside them, and show the table."""
    show.say(f"{len(seeds)} people who move fast, {frames} frames each, {FPS:g} a second")
    with show.steps("rendering") as advance:
        for k, seed in enumerate(seeds):
            synthesise(PERSON, sequence_of(out, seed), frames, seed=seed, kinect=True)
            advance(k + 1, len(seeds))
    ways = {FILTER: choose_settings("gepf", "default", None, None, 0), LONE: lone_settings()}
    jobs = [
        # pictures of the first alone, as they take longest
        Job(sequence_of(out, seed), out / f"{method}-{seed}", settings, pool, pictures=seed == seeds[0])
        for seed in seeds
        for method, settings in ways.items()
    ]
    for run in run_pool(jobs, None, BarAlone(show)):
        if run.code not in (DONE, NOT_TRACKED):
            raise GepfError(f"{run.job.out} ended with exit code {run.code}: {run.line}")
    scores = {method: [score(out, method, seed) for seed in seeds] for method in (LONE, FILTER)}
    for line in tabulate(scores):
        show.say(line)
    drawn = [out / f"{method}-{seeds[0]}" / FILM_FILE for method in (FILTER, LONE)]
    show.say(f"look at {drawn[0]} and {drawn[1]}")


def lone_settings() -> Settings:
    """The best single particle."""
    settings = choose_settings("gepf", "default", 1, LONE_POINTS, 0)
    refine = msgspec.structs.replace(settings.refine, icp_iterations=LONE_ITERATIONS)
    return msgspec.structs.replace(settings, refine=refine)


def sequence_of(out: Path, seed: int) -> Path:
    """The folder of a sequence."""
    return out / f"sequence-{seed}"


def score(out: Path, method: str, seed: int) -> Score:
    """How well a run fits the truth; a frame in which nobody was found counts as far off."""
    found = compare(read_track(out / f"{method}-{seed}"), read_truth(sequence_of(out, seed) / TRUTH_FILE))
    near, far, mean = found.joint_m <= NEAR_M, ~(found.joint_m <= FAR_M), overall(found.joint_m)
    return Score(
        near_percent=100.0 * float(near.mean()),
        mean_cm=np.nan if mean is None else 100.0 * mean,
        off_percent=100.0 * float(far.any(axis=1).mean()),
    )


def tabulate(scores: dict[str, list[Score]]) -> list[str]:
    """Lines of a table: each person, the mean, and who did better, whoever that is."""
    lone, many = scores[LONE], scores[FILTER]
    rows = [row(f"person {k}", one, other) for k, (one, other) in enumerate(zip(lone, many, strict=True))]
    better = sum(other.near_percent > one.near_percent for one, other in zip(lone, many, strict=True))
    worse = sum(other.near_percent < one.near_percent for one, other in zip(lone, many, strict=True))
    return [
        "joints within 10 cm (mean error; frames with a joint more than 15 cm off)",
        f"{'':<10}{'one particle':>28}{'gepf, 20 particles':>28}",
        *rows,
        row("mean", mean_of(lone), mean_of(many)),
        f"gepf is better for {better} of {len(rows)} people, one particle for {worse}",
    ]


def row(name: str, *scores: Score) -> str:
    """A line of the table."""
    cells = [f"{s.near_percent:5.1f} % ({s.mean_cm:4.1f} cm; {s.off_percent:3.0f} %)" for s in scores]
    return f"{name:<10}" + "".join(f"{cell:>28}" for cell in cells)


def mean_of(scores: Sequence[Score]) -> Score:
    """All people count the same."""
    return Score(*np.mean([astuple(each) for each in scores], axis=0).tolist())


def demo_arm(
    out: Path,
    show: Show,
    pool: Pool,
    connect: Connect = connect_workers,
    frames: int = ARM_FRAMES,
) -> None:
    """Make the sequence in `out`, track it with each method into a folder of its own, and show the table."""
    with show.steps("rendering the sequence") as advance:
        synthesise("arm", out / "sequence", frames, NOISE.depth, NOISE.lateral, advance=advance)
    for method, particles in COMPARED.items():
        show.say(f"tracking with {method}")
        settings = choose_settings(method, "default", particles, None, seed=0)
        job = Job(out / "sequence", out / method, settings, pool, active=ARM_DOFS)
        track(job, show, connect)
    truth = read_truth(out / "sequence" / TRUTH_FILE)
    for line in tabulate_angles({method: compare(read_track(out / method), truth) for method in COMPARED}):
        show.say(line)
    show.say(f"look at {out / 'gepf' / FILM_FILE} and the other pictures beside it")


def tabulate_angles(errors: dict[str, Errors]) -> list[str]:
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
