"""How a start fares: python -m benchmarks.start.

A start in every 15th frame of rendered people and of real ones (UTD-MHAD, subjects 1 and 2), the same after a
gap of 15 frames, and a table of situations: other poses, ways up, a camera that looks down, empty frames
first, a wrong scale, nobody, two people. All in this process, on one core; lines on stderr, tables on stdout.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.command_line import add_data, one_thread_each

PARTS = ("starts", "gaps", "real", "situations")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the parts that are asked for, and print their tables."""
    parser = argparse.ArgumentParser("python -m benchmarks.start", description=__doc__)
    add_data(parser)
    parser.add_argument("--only", nargs="+", default=PARTS, choices=PARTS)
    parser.add_argument("--subjects", nargs="+", type=int, default=(1, 2), metavar="N")
    chosen = parser.parse_args(arguments)
    one_thread_each()
    from benchmarks.start.parts import run_parts

    run_parts(chosen.data, chosen.only, chosen.subjects)
    return 0


if __name__ == "__main__":
    sys.exit(main())
