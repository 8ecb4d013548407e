"""The local worker that the runs of a batch share: it is really killed, and really frozen."""

from __future__ import annotations

import io
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.many import track_many
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.local_worker import LocalWorkerLimits
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.track import read_track
from tests.support.processes.instant_worker import DISTURBANCES, disturb
from tests.support.processes.programs import INSTANT
from tests.support.small_sequence import write_small_sequence

FRAMES = 8
NAMES = ("first", "second")


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """Two recordings, and a folder of disturbances for their worker."""
    (tmp_path / "disturbances").mkdir()
    monkeypatch.setenv(DISTURBANCES, str(tmp_path / "disturbances"))
    for name in NAMES:
        write_small_sequence(tmp_path / name, FRAMES)
    settings = settings_for("gepf", "paper", 6, 200, 0)
    pool = Pool(1, worker_command=INSTANT, worker_timeout=300.0)
    job = Job(tmp_path, tmp_path, settings, pool, pictures=False)
    return [
        replace(
            job,
            sequence=tmp_path / name,
            out=tmp_path / "runs" / name,
            init=str(tmp_path / name / "init.json"),
            active=("r_elbow_flexion",),
        )
        for name in NAMES
    ]


@pytest.mark.parametrize(("number", "times"), [(signal.SIGKILL, 4), (signal.SIGSTOP, 1)])
def test_a_batch_outlives_its_workers(
    jobs: list[Job], number: signal.Signals, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However often the worker dies after it has served, and if it freezes, it is replaced; all runs end."""
    monkeypatch.setattr("gepf.coordinator.pool.local_worker.LIMITS", LocalWorkerLimits(absence_s=1.0))
    written = io.StringIO()
    for _ in range(times):
        disturb(tmp_path / "disturbances", number)
    assert track_many(jobs, Show(Console(file=written, width=300))) in (0, 3), written.getvalue()
    assert [*(tmp_path / "disturbances").iterdir()] == []
    assert written.getvalue().count("was ended by SIGKILL; starting it again") == times
    assert [len(read_track(job.folder).frame) for job in jobs] == [FRAMES, FRAMES]
