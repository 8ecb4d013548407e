"""Whether what the tracker says of how sure it is holds: python -m benchmarks.certainty.

The hard actions of UTD-MHAD at 30, 15 and 10 frames a second, where depth does not contradict the reference:
how many joints lie within one and two deviations, and how many of those more than 15 cm off are flagged at
which share of false alarms. With --fit what it goes by is fitted anew first, on subjects 1 and 2 and on
rendered people with exact truth, and written to coordinator/tracking/certainty/fitted.py. Lines on stderr,
a table on stdout, numbers in a JSON file where asked. Exit code 1 if a recording crashed. How well one
particle knows that it has lost a limb: --demo 12 --set method=gradient.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchmarks.certainty.measure import measure
from benchmarks.running import add_changes, add_data, add_processes, command_line, measured

EVERY = [1, 2, 3]  # n-th of 30 frames a second


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, keep the numbers."""
    parser = command_line("certainty", __doc__)
    add = parser.add_argument
    add_data(parser)
    add("--fit", action="store_true", help="fit anew on subjects 1 and 2 and rendered people")
    add("--subjects", nargs="+", type=int, default=[3, 4], help="default: 3 4, of whom nothing was fitted")
    add("--demo", type=int, metavar="N", help="N rendered people of gepf demo in place of the subjects")
    add(
        "--every",
        nargs="+",
        type=int,
        metavar="N",
        help="of 30 frames a second; default: 1 2 3. Of the demo's 10: 1",
    )
    add("--cut", type=float, metavar="SHARE", help="pictures end so far up from the knees to the hips")
    add_changes(parser)
    add("--seeds", type=int, default=3, metavar="N", help="default: 3")
    add_processes(parser)
    chosen = parser.parse_args(arguments)
    if chosen.every is None:
        chosen.every = EVERY if chosen.demo is None else [1]
    return measured(measure, chosen)


if __name__ == "__main__":
    sys.exit(main())
