"""What each refine and filter setting of preset default is worth: python -m benchmarks.ablation.

One setting at a time has preset paper's value, or where the presets agree half of a count and the double of
another number, on people at 10 frames a second. Finished recordings are kept in the JSON file, and a next
run goes on there. Lines on stderr, a table on stdout, numbers in the file. Exit code 1 if one crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import RESULTS, add_data, measured, one_thread_each

RESULT = RESULTS / "ablation.json"
ACTIONS = (5, 12, 14, 15, 17, 21, 25, 26, 3, 22)
"""The eight hard ones, a wave and a jog in place."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, keep the numbers."""
    chosen = parse(arguments)
    one_thread_each()
    from benchmarks.ablation.measure import Choice, measure

    return measured("ablation", measure, Choice(**vars(chosen)))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.ablation", description=__doc__)
    add = parser.add_argument
    add_data(parser)
    add("--subjects", nargs="+", type=int, default=[1, 2], help="default: 1 2, on which settings are chosen")
    add("--actions", nargs="+", type=int, default=list(ACTIONS), metavar="A", help="default: ten of 27")
    add("--only", nargs="+", metavar="SETTING", help="only these, beside the unchanged preset; default: all")
    add("--every", type=int, default=3, metavar="N", help="of 30 frames a second; default: 3")
    add("--frames", type=int, default=14, metavar="N", help="of each recording; default: the first 14")
    add("--seeds", type=int, default=3, metavar="N", help="default: 3")
    add("--minutes", type=float, metavar="M", help="begin no recording after so long (default: all)")
    add(
        "--out",
        type=Path,
        default=RESULT,
        metavar="FILE",
        help="default: ablation.json in benchmarks/results",
    )
    add("--into", type=Path, metavar="FILE", help="write the table between the marks in this document, too")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
