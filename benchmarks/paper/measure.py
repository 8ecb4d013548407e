"""Run all rows that are chosen, and tell how well that went."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.forks import Crash, run_forked
from benchmarks.paper.bound import as_bound, bound_of_frames, informations, smoothed
from benchmarks.paper.footage import Footage, shoot
from benchmarks.paper.hidden import visible_joints
from benchmarks.paper.matrix import HEAVY, POINTS, Row, choose
from benchmarks.paper.pictures import draw
from benchmarks.paper.report import Bounds, report
from benchmarks.paper.runs import Job, Run, run
from benchmarks.paper.scores import score_row, score_run
from benchmarks.paper.shelf import Shelf
from benchmarks.paper.tables import show
from benchmarks.people import WIDTH, keep
from coordinator.synthesis.scenes import ARM_DOFS, Scene
from worker.cli import load_kernel

EVERY = 4  # frames between those whose information is rendered


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    only: Sequence[str] | None
    seeds: int | None  # at the most
    processes: int
    runs: Path
    pictures: Path
    out: Path | None


def measure(choice: Choice) -> int:
    """Exit code: 1 if a run crashed. InputError for what makes no sense, before anything is run."""
    rows = choose(choice.only, choice.seeds)
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    console.print("rendering, loading kernels")
    footages = {scene: shoot(scene) for scene in dict.fromkeys(row.scene for row in rows)}
    load_kernel()
    results, crashes = run_all(rows, footages, Shelf(choice.runs), choice.processes, console)
    visible = {scene: visible_joints(footages[scene].scene) for scene in footages if scene == "turn"}
    scored = [score_row(row, results[row.name], visible.get(row.scene)) for row in rows if results[row.name]]
    bounds = bounds_of(footages["arm"].scene) if any(row.part == "heavy" for row in rows) else None
    found = report(scored, bounds, choice.processes, crashes)
    show(found, Console(width=None if sys.stdout.isatty() else WIDTH))
    for file in draw(results, scored, choice.pictures):
        console.print(f"drew {file}")
    if choice.out is None:
        console.print("the numbers of a part are kept only with --out FILE")
    else:
        keep(found, choice.out)
    return 1 if crashes else 0


def run_all(
    rows: Sequence[Row], footages: dict[str, Footage], shelf: Shelf, processes: int, console: Console
) -> tuple[dict[str, list[Run]], dict[str, str]]:
    """The runs of each row by seed, and what went wrong by run. Those that are kept are not run again."""
    found: dict[str, list[Run]] = {row.name: [] for row in rows}
    crashes: dict[str, str] = {}
    waiting: list[Job] = []
    for job in [Job(row, seed) for row in rows for seed in range(row.seeds)]:
        kept = shelf.find(job, footages[job.row.scene])
        if kept is None:
            waiting.append(job)
        else:
            found[job.row.name].append(kept)
    console.print(f"{len(waiting)} runs to do, {sum(map(len, found.values()))} are there")
    finished = run_forked(lambda job: run(job, footages[job.row.scene]), waiting, processes)
    for count, (job, result) in enumerate(finished, start=1):
        console.print(f"{count:3} of {len(waiting)}  {job.row.name:<28} seed {job.seed}  {describe(result)}")
        if isinstance(result, Crash):
            crashes[f"{job.row.name} seed {job.seed}"] = result.error
        else:
            shelf.keep(result, job, footages[job.row.scene])
            found[job.row.name].append(result)
    return {name: sorted(runs, key=lambda one: one.seed) for name, runs in found.items()}, crashes


def describe(result: Run | Crash) -> str:
    """How one run went: a line, or after a crash the trace."""
    if isinstance(result, Crash):
        return f"crashed: {result.error}\n{result.trace}".rstrip()
    scored = score_run(result, 0, None)
    lost = "" if scored.lost_from_frame is None else f"  lost from {scored.lost_from_frame}"
    return (
        f"reported {scored.reported_deg:6.2f}  best {scored.best_deg:6.2f} degrees"
        f"  {scored.ms_per_frame:7.1f} ms{lost}"
    )


def bounds_of(scene: Scene) -> Bounds:
    """What the arm's frames under heavy noise allow."""
    frames = list(range(0, len(scene.poses), EVERY))
    measured, everything, counts = informations(scene, ARM_DOFS, HEAVY, frames)
    told = measured * np.minimum(1.0, POINTS / counts)[:, None, None]
    all_frames = np.repeat(told, EVERY, axis=0)[: len(scene.poses)]
    moving = scene.poses[:, [scene.model.dof(name) for name in ARM_DOFS]]
    acceleration = np.std(np.diff(moving, n=2, axis=0), axis=0)
    return Bounds(
        noise=HEAVY,
        single_frame=[
            bound_of_frames(measured, everything, counts, ARM_DOFS, points)
            for points in (4_000, POINTS, None)
        ],
        filtered=as_bound(smoothed(all_frames, acceleration, ahead=False), ARM_DOFS, POINTS),
        smoothed=as_bound(smoothed(all_frames, acceleration, ahead=True), ARM_DOFS, POINTS),
    )
