"""A run in a real process that ends early, by a signal or without workers, and its continuation."""

from __future__ import annotations

import errno
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gepf.coordinator.commands.console import describe_fault
from tests.support.processes.place import Place, recorded
from tests.support.processes.programs import is_alive, wait_until
from tests.support.processes.warm_processes import end

FRAMES = 120


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """A sequence, and an undisturbed run of it."""
    found = Place(tmp_path_factory.mktemp("endings"), FRAMES)
    with found.workers(calm=1):
        found.finish(found.folder / "calm")
    return found


@pytest.fixture
def out(place: Place, tmp_path: Path) -> Iterator[Path]:
    """The folder of a disturbed run; afterwards it must continue to the bytes of the undisturbed run."""
    yield tmp_path / "out"
    with place.workers(late=1):
        assert place.finish(tmp_path / "out", "--resume") == (place.folder / "calm/track.npz").read_bytes()


@pytest.mark.parametrize(("number", "frames"), [(signal.SIGTERM, 2), (signal.SIGINT, 1)])
def test_a_signal_ends_it_well(
    place: Place, out: Path, tmp_path: Path, number: signal.Signals, frames: int
) -> None:
    """Its worker ends with it, the frames are kept, and a line says how to continue."""
    run = place.begin(out, "--workers", "1", log=tmp_path / "log")
    wait_until(lambda: recorded(out) >= frames)
    workers = [int(pid) for pid in Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()]
    assert end(run, number) == 130
    assert len(workers) == 1
    assert not any(map(is_alive, workers))
    lines = (tmp_path / "log").read_text().splitlines()
    kept = recorded(out)
    assert lines[-2] == (f"ended early with {kept} of {FRAMES} frames in {out}; --resume continues")
    assert lines[-1] == "gepf: stopped"
    assert (out / "track.npz").exists()


def test_without_workers_it_says_so_and_waits(place: Place, out: Path, tmp_path: Path) -> None:
    """One line, and it continues when a worker joins under the old name."""
    log = tmp_path / "log"
    run = place.begin(out, log=log)
    with place.workers(a=1) as workers:
        wait_until(lambda: recorded(out) >= 2)
        workers.kill("a")
        wait_until(lambda: "no worker is connected; waiting for one" in log.read_text())
        kept = recorded(out)
        time.sleep(0.5)
        assert recorded(out) == kept < FRAMES
        workers.start("a")
        run.join(300.0)
    assert run.exitcode == 0


def test_a_full_disk_is_told_with_what_to_do() -> None:
    """The message says which file failed, and how to continue the run."""
    told = describe_fault(OSError(errno.ENOSPC, "No space left on device", "run/frames.log"))
    assert told.startswith("no space is left on the disk for run/frames.log; make room")
    assert "--resume" in told
    assert describe_fault(OSError(errno.EIO, "bad")).endswith("(gepf --debug shows the traceback)")
