"""What the command lines of the benchmarks share: where the data is, processes, settings, threads, misuse."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from common.errors import InputError
from coordinator.pool.local_workers import THREADS

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared" / "data"
RESULTS = ROOT / "benchmarks" / "results"

C = TypeVar("C")


def one_thread_each() -> None:
    """Keep numpy to one thread; it reads this when it is loaded."""
    os.environ.update(dict.fromkeys(THREADS, "1"))


def measured(name: str, measure: Callable[[C], int], choice: C) -> int:
    """Measure what is chosen and return the exit code; what is at fault is one line."""
    try:
        return measure(choice)
    except InputError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2


def add_data(parser: argparse.ArgumentParser) -> None:
    """`--data`."""
    parser.add_argument(
        "--data", type=Path, default=DATA, metavar="DIR", help="default: ../shared/data beside the checkout"
    )


def add_changes(parser: argparse.ArgumentParser) -> None:
    """`--set`."""
    parser.add_argument(
        "--set", nargs="+", default=[], action="extend", dest="changes", metavar="KEY=VALUE", help="settings"
    )


def add_processes(parser: argparse.ArgumentParser) -> None:
    """`--processes`."""
    parser.add_argument(
        "--processes", type=int, default=os.cpu_count() or 1, metavar="N", help="default: one per core"
    )
