"""`gepf track` without what takes long and takes no part: no pictures, and a body that was built before.

For sequences of `tests.support.small_sequence`. Importing it imports all that a run needs.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from coordinator.bodies.human.template import human
from coordinator.cli import main
from coordinator.commands.progress import Show
from coordinator.commands.workers import connect_workers
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.small_sequence import OPTIONS

human()  # built once, and kept, for all processes that are forked from this one


def track(sequence: Path, out: Path, endpoint: str, *options: str) -> int:
    """Run the command line in this process, with workers of others; gives its exit code."""
    pool = ("--workers", "0", "--listen", endpoint, "--no-pictures")
    return main(["track", str(sequence), "--out", str(out), *OPTIONS, *pool, *options], connect)


def connect(pool: Pool, show: Show) -> ZenohRefiner:
    """As ever, but that nobody is there is reported soon."""
    return connect_workers(replace(pool, patience=0.5), show)
