"""Several recordings as one real process: what Ctrl-C leaves, and certificates that a batch cannot take."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from coordinator.cli import main
from coordinator.results.track import read_track
from tests.support.processes.programs import wait_until
from tests.support.small_sequence import write_small_sequence

FRAMES, NAMES = 400, ("a", "b", "c")


def test_an_interrupt_ends_all_and_each_can_be_gone_on_with(tmp_path: Path) -> None:
    """Exit code 130 within seconds, frames of those under way kept, and --resume does the rest of all."""
    write_small_sequence(tmp_path / NAMES[0], FRAMES)
    for name in NAMES[1:]:
        shutil.copytree(tmp_path / NAMES[0], tmp_path / name)
    options = ["--out", str(tmp_path / "runs"), "--no-pictures", "--particles", "4", "--points", "200"]
    command = ["track", *(str(tmp_path / name) for name in NAMES), *options, "--workers", "1"]
    log = tmp_path / "runs" / NAMES[0] / "frames.log"
    with subprocess.Popen(
        [sys.executable, "-m", "coordinator.cli", *command],
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        wait_until(lambda: log.exists() and log.stat().st_size > 40_000, 120.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "gepf: stopped"
    assert 0 < len(read_track(tmp_path / "runs" / NAMES[0]).frame) < FRAMES
    some = ["--frames", "0:400"]
    again = subprocess.run(
        [sys.executable, "-m", "coordinator.cli", *command, *some, "--resume", "-q"],
        check=False,
        timeout=300.0,
    )
    assert again.returncode in (0, 3)
    tracks = [read_track(tmp_path / "runs" / name) for name in NAMES]
    assert all(np.array_equal(track.pose, tracks[0].pose) for track in tracks)
    assert len(tracks[0].frame) == FRAMES


def test_a_batch_with_certificates_is_refused_with_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, before anything is started."""
    made = tmp_path / "certificates"
    assert main(["certificates", "--out", str(made), "--workers", "1"]) == 0
    for name in NAMES[:2]:
        write_small_sequence(tmp_path / name, 2)
    names = {"ca": "ca.pem", "cert": "coordinator.pem", "key": "coordinator.key"}
    tls = [word for option, file in names.items() for word in (f"--tls-{option}", str(made / file))]
    recordings = [str(tmp_path / name) for name in NAMES[:2]]
    listen = ["--listen", "tls/127.0.0.1:7463"]
    capsys.readouterr()
    assert main(["track", *recordings, "--out", str(tmp_path / "runs"), *listen, *tls]) == 2
    assert "several recordings share no certificates yet" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("command", "name"), [("show", "body.png"), ("export", "body.urdf")])
def test_a_drawn_or_written_body_replaces_nothing_unless_told(
    tmp_path: Path, command: str, name: str
) -> None:
    """`gepf model show` and `export` as processes: exit code 2, the file untouched; --force replaces it."""
    out = tmp_path / name
    out.write_text("mine")
    line = [
        sys.executable,
        "-m",
        "coordinator.cli",
        "model",
        command,
        "examples/arm7.urdf",
        "--out",
        str(out),
    ]
    root = Path(__file__).parents[2]
    refused = subprocess.run(line, capture_output=True, text=True, check=False, cwd=root)
    assert refused.returncode == 2
    assert (
        refused.stderr == f"gepf: {out} is there already; replace it with --force, or choose another name\n"
    )
    assert out.read_text() == "mine"
    subprocess.run([*line, "--force"], check=True, cwd=root)
    assert out.read_bytes() != b"mine"
