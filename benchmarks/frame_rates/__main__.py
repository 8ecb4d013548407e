"""How well people are tracked at low frame rates: python -m benchmarks.frame_rates.

UTD-MHAD with every n-th of its frames, against the SDK's skeletons, by frame number. At 30 frames a second
one particle does about as well as many; the fewer frames there are, the more the filter is worth. Lines on
stderr, a table on stdout, numbers in a JSON file where asked. Exit code 1 if a recording crashed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.real_people import DATA
from coordinator.pool.local_workers import THREADS


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, keep the numbers where asked."""
    chosen = parse(arguments)
    os.environ.update(dict.fromkeys(THREADS, "1"))  # read when numpy is loaded, which is below
    from benchmarks.frame_rates.measure import Choice, measure
    from common.errors import InputError

    try:
        return measure(Choice(**vars(chosen)))
    except InputError as error:
        sys.stderr.write(f"frame_rates: {error}\n")
        return 2


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.frame_rates", description=__doc__)
    add = parser.add_argument
    add("--data", type=Path, default=DATA, metavar="DIR", help="default: ../shared/data beside the checkout")
    add("--every", nargs="+", type=int, default=[1, 2, 3, 5], metavar="N", help="of 30 frames a second")
    add("--subjects", nargs="+", type=int, default=[1, 2], help="default: 1 2, on which settings are chosen")
    add("--actions", nargs="+", type=int, metavar="A", help="default: the eight hard ones")
    add("--rows", nargs="+", metavar="NAME", help="default: all; such as 'never moves', gradient")
    add("--set", nargs="+", default=[], action="extend", dest="changes", metavar="KEY=VALUE", help="settings")
    add("--seeds", type=int, default=3, metavar="N", help="default: 3")
    add("--processes", type=int, default=os.cpu_count() or 1, metavar="N", help="default: one per core")
    add("--out", type=Path, metavar="FILE", help="keep the numbers here")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
