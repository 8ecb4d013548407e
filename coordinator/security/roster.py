"""The workers that are let in: a text file beside the authority's certificate, one name a line."""

from __future__ import annotations

from pathlib import Path

from common.errors import InputError
from common.protocol.keys import check_name
from common.transport.access import COORDINATOR, ROUTER

ROSTER = "workers.txt"


def read_roster(ca: Path) -> tuple[str, ...]:
    """The workers beside an authority's certificate; InputError if there is no such file."""
    path = ca.parent / ROSTER
    if not path.exists():
        raise InputError(f"{path} is missing; write the names of the workers to let in there, one a line")
    return list_workers(path)


def list_workers(path: Path) -> tuple[str, ...]:
    """The names in a file, none if it is not there; InputError for what is no worker's name."""
    lines = path.read_text(errors="replace").splitlines() if path.exists() else []
    names = (line.strip() for line in lines)
    return tuple(check_worker(name) for name in names if name and not name.startswith("#"))


def write_roster(path: Path, workers: tuple[str, ...]) -> None:
    """Write names, one a line."""
    path.write_text("".join(f"{worker}\n" for worker in workers))


def choose_names(workers: str) -> tuple[str, ...]:
    """Workers' names between commas, or `worker-0` and so on for a number."""
    if workers.isascii() and workers.isdigit():
        return tuple(f"worker-{k}" for k in range(int(workers)))
    return tuple(check_worker(name.strip()) for name in workers.split(","))


def check_worker(name: str) -> str:
    """A name that a worker may have; InputError otherwise."""
    if name in (COORDINATOR, ROUTER):
        raise InputError(f"a worker cannot be called '{name}'; give another name")
    return check_name("worker name", name)
