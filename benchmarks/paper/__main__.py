"""The paper's experiments with the baselines beside them: python -m benchmarks.paper.

Every row is a method with a number of particles, under some noise, for some seeds. All runs happen in
processes of their own, with the kernel in the tracker's process; each is kept as soon as it is done, so that
a benchmark that was broken off goes on. Lines on stderr, tables on stdout, numbers in a JSON file, pictures
in docs/. Exit code 1 if a run crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import RESULTS, ROOT, add_processes, measured, one_thread_each

QUICK_SEEDS = 2
RESULT = RESULTS / "paper.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, keep the numbers."""
    chosen = parse(arguments)
    one_thread_each()
    from benchmarks.paper.measure import Choice, measure

    return measured("paper", measure, Choice(**vars(chosen)))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line. What is measured only in part is kept only where asked."""
    parser = argparse.ArgumentParser("python -m benchmarks.paper", description=__doc__)
    add = parser.add_argument
    add("--quick", dest="seeds", action="store_const", const=QUICK_SEEDS, help="the same as --seeds 2")
    add(
        "--seeds",
        type=int,
        metavar="N",
        help="so many seeds at the most; default: what each row has, 10 or less",
    )
    add("--only", nargs="+", metavar="NAME", help="only these rows or parts: heavy, curves, gradient-paper")
    add_processes(parser)
    add(
        "--runs",
        type=Path,
        default=ROOT / "runs" / "paper",
        metavar="DIR",
        help="finished runs; default: runs/paper",
    )
    add("--pictures", type=Path, metavar="DIR", help="default: docs, or what is measured in part, runs/paper")
    add("--out", type=Path, metavar="FILE", help=f"default: {RESULT.name} in benchmarks/results")
    chosen = parser.parse_args(arguments)
    if chosen.processes < 1:
        parser.error(f"--processes {chosen.processes} is too small; give 1 or more")
    if chosen.seeds is not None and chosen.seeds < 1:
        parser.error(f"--seeds {chosen.seeds} is too small; give 1 or more")
    whole = not (chosen.only or chosen.seeds)
    if chosen.out is None and whole:
        chosen.out = RESULT
    if chosen.pictures is None:
        chosen.pictures = ROOT / "docs" if whole else chosen.runs
    return chosen


if __name__ == "__main__":
    sys.exit(main())
