"""What each setting of preset default is worth alone: python -m benchmarks.ablation.

Every setting in which the presets differ is put back to the paper's value, one at a time, and what both have
beyond the paper is taken away, on the arm behind heavy noise and on two real people. Lines on stderr, a table
on stdout, numbers in a JSON file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import RESULTS, add_data, add_processes, measured, one_thread_each

RESULT = RESULTS / "ablation.json"
PEOPLE = ("a14_s2", "a24_s2")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, keep the numbers."""
    chosen = parse(arguments)
    one_thread_each()
    from benchmarks.ablation.settings_alone import Choice, measure

    return measured("ablation", measure, Choice(**vars(chosen)))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.ablation", description=__doc__)
    add = parser.add_argument
    add_data(parser)
    add("--only", nargs="+", metavar="SETTING", help="only these settings")
    add("--people", nargs="*", default=PEOPLE, metavar="NAME", help=f"default: {' '.join(PEOPLE)}")
    add("--frames", type=int, default=110, metavar="N", help="of the arm; default: 110")
    add("--seeds", type=int, default=1, metavar="N", help="of the arm; default: 1")
    add_processes(parser)
    add(
        "--out",
        type=Path,
        default=RESULT,
        metavar="FILE",
        help="default: ablation.json in benchmarks/results",
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
