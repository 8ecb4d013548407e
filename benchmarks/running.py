"""Shared by all benchmarks: options, settings, jobs in their own processes, results."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from rich.console import Console

from gepf.common.errors import InputError
from gepf.coordinator.files import write_atomically
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.results.configuration import versions
from gepf.coordinator.settings import Settings

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared" / "data"
RESULTS = ROOT / "runs" / "benchmarks"
WIDTH = 150  # columns of a table that is not written to a terminal

J = TypeVar("J")
R = TypeVar("R")


def command_line(name: str, description: str | None) -> argparse.ArgumentParser:
    """A parser for a benchmark's options; `--out` is common to all."""
    parser = argparse.ArgumentParser(f"python -m benchmarks.{name}", description=description)
    out = RESULTS / f"{name.replace('.', '-')}.json"
    parser.add_argument("--out", type=Path, default=out, metavar="FILE", help="numbers; default: %(default)s")
    return parser


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add `--data`."""
    text = "default: ../shared/data beside the checkout"
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR", help=text)


def add_changes(parser: argparse.ArgumentParser) -> None:
    """Add `--set`."""
    kinds: dict[str, Any] = {"nargs": "+", "action": "extend", "default": [], "dest": "changes"}
    parser.add_argument("--set", metavar="KEY=VALUE", help="settings", **kinds)


def add_processes(parser: argparse.ArgumentParser) -> None:
    """Add `--processes`."""
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="N")


def measured(measure: Callable[[argparse.Namespace], int], chosen: argparse.Namespace) -> int:
    """Measure and return the exit code; wrong input is reported in one line."""
    try:
        return measure(chosen)
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2


def settings_with(changes: Sequence[str], particles: int | None = None, seed: int = 0) -> Settings:
    """The default settings with changes `key=value`; InputError if one is invalid.

    `preset` and `method` have the meaning of the options of `gepf track`; all other keys are settings.
    """
    for change in changes:
        if "=" not in change:
            raise InputError(f"--set {change} is not of the form key=value; write e.g. --set particles=20")
    given = {key: read_value(text) for key, _, text in (change.partition("=") for change in changes)}
    method, preset = given.pop("method", "gepf"), given.pop("preset", "default")
    plain = msgspec.to_builtins(settings_for(str(method), str(preset), particles, None, seed))
    for key, value in given.items():
        parts = [part for part in (plain, plain["refine"], plain["filter"]) if key in part]
        if not parts:
            raise InputError(
                f"no setting '{key}'; choose from {', '.join([*plain['refine'], *plain['filter']])}"
            )
        parts[0][key] = value
    try:
        return msgspec.convert(plain, Settings)
    except msgspec.ValidationError as error:
        raise InputError(f"--set {' '.join(changes)} is not valid: {error}; give another value") from error


def read_value(text: str) -> Any:
    """A JSON value, or a string if it is not JSON."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


@dataclass(frozen=True, slots=True)
class Crash:
    """A job without a result."""

    error: str


def run_forked(work: Callable[[J], R], jobs: Iterable[J], processes: int) -> Iterator[tuple[J, R | Crash]]:
    """Each job with its result, when it ends; processes are forked and so start with the present memory."""
    global _work  # noqa: PLW0603 forked processes inherit it, so it is not pickled
    _work = work
    with ProcessPoolExecutor(processes, multiprocessing.get_context("fork")) as pool:
        running = {pool.submit(_call, job): job for job in jobs}
        for done in as_completed(running):
            error = done.exception()
            result = done.result() if error is None else Crash("".join(traceback.format_exception(error)))
            yield running[done], result


_work: Callable[[Any], Any]


def _call(job: Any) -> Any:
    return _work(job)


def progress() -> Console:
    """The console for progress."""
    return Console(stderr=True, soft_wrap=True, highlight=False, markup=False)


def screen() -> Console:
    """The console for tables."""
    return Console(width=None if sys.stdout.isatty() else WIDTH)


def keep(result: object, path: Path) -> None:
    """Write the numbers as JSON, with versions of packages and the machine."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = {"versions": versions(), "processor": processor(), "result": result}
    text = msgspec.json.format(msgspec.json.encode(whole, enc_hook=lambda value: value.tolist()), indent=2)
    write_atomically(path, lambda file: file.write(text + b"\n"))


def processor() -> str:
    """The processor's name, from Linux."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
