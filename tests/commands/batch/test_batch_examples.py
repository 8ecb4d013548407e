"""The batch examples are short; those for Snakemake and Dask track two recordings."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gepf
from tests.support.small_sequence import write_small_sequence

ROOT = Path(__file__).parents[3]
BATCH = ROOT / "examples" / "batch"
BIN = Path(sys.executable).parent
NAMES = ("first", "second")
FRAMES = 3


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with two recordings."""
    write_small_sequence(tmp_path / "recordings" / NAMES[0], FRAMES)
    shutil.copytree(tmp_path / "recordings" / NAMES[0], tmp_path / "recordings" / NAMES[1])
    return tmp_path


def run(folder: Path, *command: str | Path) -> str:
    """What a command prints in the folder, with gepf on the path; it must succeed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("example", sorted(BATCH.iterdir()), ids=lambda path: path.name)
def test_an_example_is_short(example: Path) -> None:
    """At most twenty lines."""
    assert len(example.read_text().splitlines()) <= 20


@pytest.mark.slow
def test_snakemake_tracks_what_is_missing(folder: Path) -> None:
    """Both recordings; then nothing; then only that whose run was deleted."""
    command = (BIN / "snakemake", "--snakefile", BATCH / "Snakefile", "--cores", "2")
    run(folder, *command)
    tracks = [gepf.load(folder / "runs" / name).track for name in NAMES]
    assert len(tracks[0].frame) == FRAMES
    assert np.array_equal(tracks[0].pose, tracks[1].pose)
    assert "Nothing to be done" in run(folder, *command)
    shutil.rmtree(folder / "runs" / NAMES[1])
    kept = folder / "runs" / NAMES[0] / "summary.json"
    written = kept.stat().st_mtime_ns
    run(folder, *command)
    assert kept.stat().st_mtime_ns == written
    assert (folder / "runs" / NAMES[1] / "summary.json").exists()


@pytest.mark.slow
def test_dask_tracks_on_its_processes(folder: Path) -> None:
    """`gepf.track` and its run pass between processes; the results are those of a run alone."""
    recordings = [folder / "recordings" / name for name in NAMES]
    said = run(folder, sys.executable, BATCH / "dask_runs.py", "runs", *recordings)
    assert sorted(line for line in said.splitlines() if line.endswith("frames")) == [
        f"{folder / 'runs' / name} {FRAMES} frames" for name in NAMES
    ]
    alone = gepf.track(recordings[0], folder / "alone", quiet=True, workers=None)
    for name in NAMES:
        assert np.array_equal(gepf.load(folder / "runs" / name).track.pose, alone.track.pose)
