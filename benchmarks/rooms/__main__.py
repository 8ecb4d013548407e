"""How well people are tracked in rooms: python -m benchmarks.rooms.

Real people (UTD-MHAD) put into rendered rooms with exact masks, each tracked beside the same recording cut
out already: joints within 10 cm, frames that are not tracked, precision and recall of the cut, milliseconds
of processor time a frame. The kernel is in the tracker's own process; a recording and its rooms share a
process. Lines on stderr, a table on stdout, numbers in a JSON file; what is measured only in part replaces
those recordings in it.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from coordinator.pool.local_workers import THREADS

HERE = Path(__file__).parent
SHARED = HERE.parents[2] / "shared"
RESULT = HERE.parent / "results" / "rooms.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, keep the numbers."""
    chosen = parse(arguments)
    os.environ.update(dict.fromkeys(THREADS, "1"))  # read when numpy is loaded, which is below
    from benchmarks.rooms.measure import Choice, measure
    from common.errors import InputError

    try:
        return measure(Choice(**vars(chosen)))
    except InputError as error:
        sys.stderr.write(f"rooms: {error}\n")
        return 2


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.rooms", description=__doc__)
    add = parser.add_argument
    add("--shared", type=Path, default=SHARED, metavar="DIR", help="holds data and tools; default: ../shared")
    add("--only", nargs="+", metavar="NAME", help="only these: a14_s2, or a14 (all of this action)")
    add("--kinds", nargs="+", metavar="KIND", help="only these rooms: plain, cluttered, table, visitor, wall")
    add("--seed", type=int, default=SEED, metavar="N", help="of the rooms")
    add("--processes", type=int, default=os.cpu_count() or 1, metavar="N", help="default: one per core")
    add("--out", type=Path, default=RESULT, metavar="FILE", help="default: rooms.json in benchmarks/results")
    chosen = parser.parse_args(arguments)
    if chosen.processes < 1:
        parser.error(f"--processes {chosen.processes} is too small; give 1 or more")
    return chosen


SEED = 15

if __name__ == "__main__":
    sys.exit(main())
