"""The paper's experiments, with baselines: python -m benchmarks.paper.

Every row is a method with a number of particles, under some noise, for some seeds, each run in a process of
its own. Lines on stderr, tables on stdout, numbers in a JSON file, pictures in docs/ or, if only a part is
measured, beside that file. Exit code 1 if a run crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.paper.bound import Bound, bounds
from benchmarks.paper.pictures import draw
from benchmarks.paper.runs import HEAVY, Job, Run, choose, run, shoot
from benchmarks.paper.scores import score_row, table, visible_joints
from benchmarks.running import (
    ROOT,
    Crash,
    add_processes,
    command_line,
    keep,
    measured,
    progress,
    run_forked,
    screen,
)
from gepf.worker.cli import load_kernel


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, write the numbers."""
    parser = command_line("paper", __doc__)
    add = parser.add_argument
    add("--seeds", type=int, metavar="N", help="at most; default: those of each row, at most 10")
    add("--only", nargs="+", metavar="NAME", help="only these rows or parts: heavy, curves, gradient-paper")
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a run crashed. InputError for what makes no sense, before anything is run."""
    rows, console = choose(chosen.only, chosen.seeds), progress()
    console.print("rendering and loading kernels")
    footages = {scene: shoot(scene) for scene in dict.fromkeys(row.scene for row in rows)}
    load_kernel(1)
    jobs = [Job(row, seed) for row in rows for seed in range(row.seeds)]
    found: dict[Job, Run] = {}
    work = run_forked(lambda job: run(job, footages[job.row.scene]), jobs, chosen.processes)
    for count, (job, result) in enumerate(work, start=1):
        line = f"{count:3} of {len(jobs)}  {job.row.name:<28} seed {job.seed}"
        if isinstance(result, Crash):
            console.print(f"{line} crashed: {result.error}")
        else:
            found[job] = result
            console.print(f"{line}  {result.reported_deg.mean():.2f} degrees  {result.ms:.1f} ms")
    seen = visible_joints(footages["turn"].scene) if "turn" in footages else None
    scores = []
    for row in rows:
        runs = [found[job] for job in jobs if job.row is row and job in found]
        if runs:
            scores.append(score_row(row, runs, seen if row.scene == "turn" else None))
    for part in dict.fromkeys(row.part for row in rows):
        screen().print(table(part, [one for one in scores if one.row.part == part]))
    allowed: list[Bound] = []
    if any(row.part == "heavy" for row in rows):
        allowed = bounds(footages["arm"].scene, HEAVY)
        for bound in allowed:
            print(f"one frame allows, {bound.points or 'all'} points: {bound.mean_deg:.2f} degrees")
    folder = chosen.out.parent if chosen.only or chosen.seeds else ROOT / "docs"
    for file in draw({row.name: found.get(Job(row, 0)) for row in rows}, scores, folder):
        console.print(f"drew {file}")
    keep({"scores": scores, "bounds": allowed}, chosen.out)
    return int(len(found) < len(jobs))


if __name__ == "__main__":
    sys.exit(main())
