"""How well people are tracked at low frame rates: python -m benchmarks.frame_rates.

UTD-MHAD with every n-th of its frames, against the SDK's skeletons, by frame number. At 30 frames a second
one particle does about as well as many; the fewer frames there are, the more the filter is worth. Lines on
stderr, a table on stdout, numbers in a JSON file where asked. Exit code 1 if a recording crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command_line import add_changes, add_data, add_processes, measured, one_thread_each


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, keep the numbers where asked."""
    chosen = parse(arguments)
    one_thread_each()
    from benchmarks.frame_rates.measure import Choice, measure

    return measured("frame_rates", measure, Choice(**vars(chosen)))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.frame_rates", description=__doc__)
    add = parser.add_argument
    add_data(parser)
    add("--every", nargs="+", type=int, default=[1, 2, 3, 5], metavar="N", help="of 30 frames a second")
    add("--subjects", nargs="+", type=int, default=[1, 2], help="default: 1 2, on which settings are chosen")
    add("--actions", nargs="+", type=int, metavar="A", help="default: the eight hard ones")
    add("--rows", nargs="+", metavar="NAME", help="default: all; such as 'never moves', gradient")
    add_changes(parser)
    add("--seeds", type=int, default=3, metavar="N", help="default: 3")
    add_processes(parser)
    add("--out", type=Path, metavar="FILE", help="keep the numbers here")
    add("--picture", type=Path, metavar="FILE", help="draw accuracy over the number of particles here")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
