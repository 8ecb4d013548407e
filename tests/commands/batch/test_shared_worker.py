"""The local worker that the runs of a batch share, really killed and really frozen."""

from __future__ import annotations

import io
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import psutil  # type: ignore[import-untyped]
import pytest
from rich.console import Console

from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.many import track_many
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.track import read_track
from tests.support.processes.place import recorded
from tests.support.processes.programs import INSTANT, in_thread
from tests.support.small_sequence import write_small_sequence

FRAMES = 24
NAMES = ("first", "second")


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """Two recordings; their frames last long enough for a disturbance."""
    monkeypatch.setenv("SECONDS_PER_PARTICLE", "0.01")
    for name in NAMES:
        write_small_sequence(tmp_path / name, FRAMES)
    settings = settings_for("gepf", "paper", 6, 200, 0)
    pool = Pool(1, worker_command=INSTANT, worker_timeout=60.0)
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


def find_worker() -> int | None:
    """The process id of the local worker of this process; None while there is none."""
    for child in psutil.Process().children():
        with suppress(psutil.Error):  # it has just ended
            if "--tied" in child.cmdline():
                return int(child.pid)
    return None


def signal_workers(
    jobs: list[Job], number: signal.Signals, times: int
) -> tuple[list[int], Callable[[threading.Event], None]]:
    """A function that signals the worker, each time after another frame; and whom it has signalled."""
    signalled = list[int]()

    def disturb(stop: threading.Event) -> None:
        seen = 0
        while len(signalled) < times and not stop.wait(0.02):
            done = sum(recorded(job.out) for job in jobs)
            worker = find_worker()
            if done > seen and worker is not None and worker not in signalled:
                seen = done
                signalled.append(worker)
                os.kill(worker, number)

    return signalled, disturb


@pytest.mark.parametrize(("number", "times"), [(signal.SIGKILL, 4), (signal.SIGSTOP, 1)])
def test_a_batch_outlives_its_workers(
    jobs: list[Job], number: signal.Signals, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However often the worker dies after it has served, and if it freezes, it is replaced; all runs end."""
    monkeypatch.setattr("gepf.coordinator.pool.local_worker.ABSENCE_S", 1.0)
    written = io.StringIO()
    signalled, disturb = signal_workers(jobs, number, times)
    with in_thread(disturb):
        code = track_many(jobs, Show(Console(file=written, width=300)))
    assert code in (0, 3), written.getvalue()
    assert len(set(signalled)) == times
    assert written.getvalue().count("was ended by SIGKILL; starting it again") == times
    assert [len(read_track(job.out).frame) for job in jobs] == [FRAMES, FRAMES]
