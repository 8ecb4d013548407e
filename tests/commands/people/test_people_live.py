"""`gepf track zenoh:KEY --people 2`, with a publisher in a process of its own."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

from coordinator.cli import main
from coordinator.files import LOG_FILE
from tests.support.pairs import FRAMES, write_pair

KEY = "camera/depth"


def free_endpoint() -> str:
    """An endpoint that is not in use."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def test_two_people_are_tracked_live(tmp_path: Path) -> None:
    """Both are found in the stream; each has a run, and one summary counts the frames."""
    where, out = free_endpoint(), tmp_path / "run"
    sequence = write_pair(tmp_path / "pair")
    play = ["publish", str(sequence), "--key", KEY, "--connect", where, "--rate", "1"]
    with subprocess.Popen([sys.executable, "-m", "coordinator.cli", *play]) as publisher:
        options = ["--people", "2", "--particles", "6", "--listen", where, "--workers", "1", "--no-pictures"]
        options += ["--idle-timeout", "60"]  # a machine that stands still cuts the link, and the end is lost
        try:
            assert main(["track", f"zenoh:{KEY}", "--out", str(out), *options]) == 0
        finally:
            publisher.kill()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] is True
    assert FRAMES - 2 <= summary["frames_received"] <= FRAMES  # what a busy link cannot take is dropped
    assert [each["folder"] for each in summary["found"]] == ["person1", "person2"]
    assert not (out / LOG_FILE).exists()
    for person in ("person1", "person2"):
        assert json.loads((out / person / "summary.json").read_text())["status"]["tracked"] > 0
