"""Several recordings in one real process: after Ctrl-C, and with certificates."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np

from coordinator.results.track import read_track
from tests.support.processes.certificates import free_port, make_folder
from tests.support.processes.place import recorded
from tests.support.processes.programs import wait_until
from tests.support.processes.warm_processes import gepf, start, work_instantly
from tests.support.small_sequence import OPTIONS, write_small_sequences

FRAMES, NAMES = 60, ("a", "b", "c")


def test_an_interrupt_ends_all_and_each_can_be_gone_on_with(tmp_path: Path) -> None:
    """Exit code 130 within seconds, frames of running recordings are kept, and --resume does the rest."""
    recordings = [tmp_path / name for name in NAMES]
    write_small_sequences(recordings, FRAMES)
    options = ["--out", str(tmp_path / "runs"), "--no-pictures", *OPTIONS]
    command = ["track", *map(str, recordings), *options, "--workers", "1"]
    said = tmp_path / "said"
    process = start(gepf, *command, log=said)
    wait_until(lambda: recorded(tmp_path / "runs" / NAMES[0]) > 1, 120.0)
    assert process.pid is not None
    os.kill(process.pid, signal.SIGINT)
    process.join(60.0)
    assert process.exitcode == 130
    assert said.read_text().splitlines()[-1] == "gepf: stopped"
    assert 0 < len(read_track(tmp_path / "runs" / NAMES[0]).frame) < FRAMES
    some = ["--frames", f"0:{FRAMES}"]
    again = start(gepf, *command, *some, "--resume", "-q", log=said)
    again.join(300.0)
    assert again.exitcode in (0, 3)
    tracks = [read_track(tmp_path / "runs" / name) for name in NAMES]
    assert all(np.array_equal(track.pose, tracks[0].pose) for track in tracks)
    assert len(tracks[0].frame) == FRAMES


def test_a_batch_takes_workers_with_certificates(tmp_path: Path) -> None:
    """Two recordings through one TLS listener: a worker with a certificate works for both."""
    made, place = make_folder(tmp_path / "certificates"), f"127.0.0.1:{free_port()}"
    recordings = [tmp_path / name for name in NAMES[:2]]
    write_small_sequences(recordings, 4)
    options = ["--no-pictures", *OPTIONS, "--workers", "0", "--worker-timeout", "60"]
    shown = ["--listen", f"tls/{place}", *made.options("coordinator")]
    connect = ("--connect", f"tls/{place}")
    command = ["track", *map(str, recordings), "--out", str(tmp_path / "runs"), *options, *shown]
    batch = start(gepf, *command, log=tmp_path / "said")
    worker = start(work_instantly, *connect, "--name", "w0", *made.options("w0"), log=tmp_path / "worker")
    batch.join(120.0)
    worker.terminate()
    worker.join()
    said = (tmp_path / "said").read_text()
    assert batch.exitcode in (0, 3), said
    assert "w0 joined" in said
    assert [len(read_track(tmp_path / "runs" / name).frame) for name in NAMES[:2]] == [4, 4]
