"""How well real people are tracked: python -m benchmarks.real_people.

All of UTD-MHAD against the SDK's skeletons, and the skinned synthetic people against the exact truth, as
`gepf track SEQ` tracks them without options, but with the kernel in the tracker's own process and each
sequence in a process of its own. Lines on stderr, tables on stdout, numbers in a JSON file. Exit code 1 if
a sequence crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import RESULTS, add_changes, add_data, add_processes, measured, one_thread_each

RESULT = RESULTS / "real_people.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, keep the numbers."""
    chosen = parse(arguments)
    one_thread_each()
    from benchmarks.people import Choice, measure

    return measured("real_people", measure, Choice(**vars(chosen)))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line. What is measured only in part, or with other settings, is kept only where asked."""
    parser = argparse.ArgumentParser("python -m benchmarks.real_people", description=__doc__)
    add = parser.add_argument
    add_data(parser)
    add("--only", nargs="+", metavar="NAME", help="only these: a14_s2, a14 (all of this action), dance")
    add("--particles", type=int, metavar="N", help="particles a frame")
    add_processes(parser)
    add_changes(parser)
    add("--out", type=Path, metavar="FILE", help=f"default: {RESULT.name} in benchmarks/results")
    chosen = parser.parse_args(arguments)
    if chosen.processes < 1:
        parser.error(f"--processes {chosen.processes} is too small; give 1 or more")
    if chosen.out is None and not (chosen.only or chosen.changes or chosen.particles):
        chosen.out = RESULT
    return chosen


if __name__ == "__main__":
    sys.exit(main())
