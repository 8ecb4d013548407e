"""The tracker's kernels, compiled by following two people for a moment: particles stay as they are."""

from __future__ import annotations

import tempfile
from pathlib import Path

from gepf.coordinator.cli import main
from tests.support.pairs import write_pair
from tests.support.stand_ins import StillWorkers

FRAMES = 3
OPTIONS = ("--people", "2", "--particles", "6", "--points", "1500", "--no-pictures", "--quiet")


def compile_all() -> None:
    """Track; the exit code is ignored, as particles that do not move find no person."""
    with tempfile.TemporaryDirectory(prefix="gepf-warm-") as name:
        folder = Path(name)
        sequence = write_pair(folder / "pair", FRAMES)
        line = ["track", str(sequence), "--out", str(folder / "out"), *OPTIONS]
        assert main(line, StillWorkers().connect) in (0, 3)


if __name__ == "__main__":
    compile_all()
