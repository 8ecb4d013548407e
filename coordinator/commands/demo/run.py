"""`gepf demo`: one of its scenes, in a folder that holds a demo or nothing."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from common.errors import InputError
from coordinator.commands.console.progress import Show
from coordinator.commands.demo.arm import demo_arm
from coordinator.commands.demo.person import demo_person
from coordinator.commands.workers import end_as_interrupted
from coordinator.pool.options import Pool

WORKERS = 2
DEFAULT_FOLDER = Path("gepf-demo")
DEMOS: dict[str, Callable[[Path, Show, Pool], None]] = {"person": demo_person, "arm": demo_arm}
OURS = re.compile(r"(sequence|gradient|one-particle|gepf)(-\d+)?")


def run_demo(out: Path | None, show: Show, scene: str = "person") -> None:
    """Render a scene, track it with one particle and with the filter, and show a table of errors.

    `out` gets folders of sequences and of runs; an earlier demo there is replaced. Raises InputError if it
    holds anything else, or for an unknown scene.
    """
    if scene not in DEMOS:
        raise InputError(f"unknown scene '{scene}'; choose from {', '.join(DEMOS)}")
    end_as_interrupted()
    out = DEFAULT_FOLDER if out is None else out
    make_room(out)
    DEMOS[scene](out, show, Pool(WORKERS))


def make_room(out: Path) -> None:
    """Remove an earlier demo from `out`; InputError if there is anything else."""
    try:
        held = [path.name for path in out.iterdir()] if out.exists() else []
        if not all(OURS.fullmatch(name) for name in held):
            raise InputError(f"'{out}' holds other things than a demo; choose another --out")
        for name in held:
            shutil.rmtree(out / name)
    except OSError as error:
        raise InputError(f"cannot write to '{out}' ({error.strerror}); choose another --out") from error
