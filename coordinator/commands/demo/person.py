"""People who move fast, at ten frames a second: the filter beside the best single particle there is.

Several people, each with a motion of their own, are rendered as a Kinect would see them. Their limbs hide
each other, and are elsewhere in the next frame: a pose that is followed alone ends in the wrong valley. One
particle gets all that helps it: twice the iterations, more than twice the points, and it is looked for
again where it is in doubt; `python -m benchmarks.frame_rates.rendered` has the other ways to track with one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.errors import GepfError
from common.settings import Settings
from coordinator.commands.batch.runs import run_pool
from coordinator.commands.console.progress import Advance, FrameMeter, Show
from coordinator.commands.exit_codes import DONE, NOT_TRACKED
from coordinator.commands.options.choices import choose_settings
from coordinator.commands.options.job import Job
from coordinator.files import ANIMATION_FILE, TRUTH_FILE
from coordinator.filters.methods import LONE_POINTS
from coordinator.pool.options import Pool
from coordinator.results.evaluation import NEAR_M, compare, overall, read_truth
from coordinator.results.track import read_track
from coordinator.synthesis.person_scene import FPS
from coordinator.synthesis.sequence import PERSON, synthesise

SEEDS = range(4)
FRAMES = 50  # of each, so that all takes little more than a minute on two cores
FAR_M = 0.15
LONE, FILTER = "one-particle", "gepf"
LONE_ITERATIONS = 6  # at 30 frames a second, as of method gradient


@dataclass(frozen=True, slots=True)
class Score:
    """One run: per cent of joints that are near, mean error, per cent of frames with a joint far off."""

    near_percent: float
    mean_cm: float
    off_percent: float


class BarAlone:
    """Shows the bar of many runs, and none of what each has to say."""

    def __init__(self, show: Show) -> None:
        self._show = show

    def say(self, text: str) -> None:
        """Say nothing."""

    def warn(self, text: str) -> None:
        """Say nothing."""

    def steps(self, text: str) -> AbstractContextManager[Advance]:
        """The bar."""
        return self._show.steps(text)

    def frames(self, total: int | None, done: int = 0) -> FrameMeter:
        """Count frames, unseen."""
        return FrameMeter(total, done)


def demo_person(
    out: Path, show: Show, pool: Pool, seeds: Sequence[int] = SEEDS, frames: int = FRAMES
) -> None:
    """Make the sequences in `out`, track each in both ways into folders beside them, and show the table."""
    show.say(f"{len(seeds)} people who move fast, {frames} frames each, {FPS:g} a second")
    with show.steps("rendering") as advance:
        for k, seed in enumerate(seeds):
            synthesise(PERSON, sequence_of(out, seed), frames, seed=seed, kinect=True)
            advance(k + 1, len(seeds))
    ended = run_pool(list(jobs(out, seeds, pool)), None, BarAlone(show))
    for run in ended:
        if run.code not in (DONE, NOT_TRACKED):
            raise GepfError(f"{run.job.out} ended with exit code {run.code}: {run.line}")
    scores = {method: [score(out, method, seed) for seed in seeds] for method in (LONE, FILTER)}
    for line in tabulate(scores):
        show.say(line)
    drawn = [out / f"{method}-{seeds[0]}" / ANIMATION_FILE for method in (FILTER, LONE)]
    show.say(f"look at {drawn[0]} and {drawn[1]}")


def jobs(out: Path, seeds: Sequence[int], pool: Pool) -> Iterator[Job]:
    """Both ways to track each sequence; pictures of the first alone, as they take longest."""
    ways = {FILTER: choose_settings("gepf", "default", None, None, 0), LONE: lone_settings()}
    for seed in seeds:
        for method, settings in ways.items():
            where = out / f"{method}-{seed}"
            yield Job(sequence_of(out, seed), where, settings, pool, pictures=seed == seeds[0])


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


def row(name: str, one: Score, other: Score) -> str:
    """A line of the table."""
    return f"{name:<10}" + "".join(f"{describe(each):>28}" for each in (one, other))


def describe(each: Score) -> str:
    """A cell."""
    return f"{each.near_percent:5.1f} % ({each.mean_cm:4.1f} cm; {each.off_percent:3.0f} %)"


def mean_of(scores: Sequence[Score]) -> Score:
    """All people count the same."""
    return Score(
        near_percent=float(np.mean([each.near_percent for each in scores])),
        mean_cm=float(np.mean([each.mean_cm for each in scores])),
        off_percent=float(np.mean([each.off_percent for each in scores])),
    )
