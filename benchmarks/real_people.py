"""How well real people are tracked: python -m benchmarks.real_people.

All of UTD-MHAD against the SDK's skeletons, and the skinned synthetic people against the exact truth, as
`gepf track SEQ` tracks them without options, but with the kernel in the tracker's own process and each
sequence in a process of its own. Lines on stderr, tables on stdout, numbers in a JSON file. Exit code 1 if
a sequence crashed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from coordinator.pool.local_workers import THREADS

HERE = Path(__file__).parent
DATA = HERE.parent.parent / "shared" / "data"
RESULT = HERE / "results" / "real_people.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, keep the numbers."""
    chosen = parse(arguments)
    os.environ.update(dict.fromkeys(THREADS, "1"))  # read when numpy is loaded, which is below
    from benchmarks.people import Choice, measure
    from common.errors import InputError

    try:
        return measure(Choice(**vars(chosen)))
    except InputError as error:
        sys.stderr.write(f"real_people: {error}\n")
        return 2


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line. What is measured only in part, or with other settings, is kept only where asked."""
    parser = argparse.ArgumentParser("python -m benchmarks.real_people", description=__doc__)
    add = parser.add_argument
    add("--data", type=Path, default=DATA, metavar="DIR", help="default: ../shared/data beside the checkout")
    add("--only", nargs="+", metavar="NAME", help="only these: a14_s2, a14 (all of this action), dance")
    add("--particles", type=int, metavar="N", help="particles a frame")
    add("--processes", type=int, default=os.cpu_count() or 1, metavar="N", help="default: one per core")
    add("--set", nargs="+", default=[], action="extend", dest="changes", metavar="KEY=VALUE", help="settings")
    add("--out", type=Path, metavar="FILE", help=f"default: {RESULT.name} in benchmarks/results")
    chosen = parser.parse_args(arguments)
    if chosen.processes < 1:
        parser.error(f"--processes {chosen.processes} is too small; give 1 or more")
    if chosen.out is None and not (chosen.only or chosen.changes or chosen.particles):
        chosen.out = RESULT
    return chosen


if __name__ == "__main__":
    sys.exit(main())
