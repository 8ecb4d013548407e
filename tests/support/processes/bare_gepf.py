"""`gepf track` without slow parts that do not matter here: no pictures, and a body built before.

For sequences of `tests.support.small_sequence`. Importing it imports all that a run needs.
"""

from __future__ import annotations

from pathlib import Path

from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.cli import main
from gepf.coordinator.pool import rpc_client
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.small_sequence import OPTIONS

setattr(rpc_client, "NOTICE_S", 0.5)  # noqa: B010 # that no worker is connected is reported soon
human()  # built once, and kept, for all processes that are forked from this one


def track(sequence: Path, out: Path, endpoint: str, *options: str) -> int:
    """Run the command line in this process, with workers of others; gives its exit code."""
    pool = ("--workers", "0", "--listen", endpoint, "--no-pictures")
    return main(["track", str(sequence), "--out", str(out), *OPTIONS, *pool, *options], ZenohRefiner)
