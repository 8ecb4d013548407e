"""Whole runs, with workers, of an empty room and of a person upside down: messages and files."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from tests.support.people import shown
from tests.support.recordings import write_open3d
from tests.support.rooms import CABINET, CAMERA, Room
from tests.support.stand_ins import Direct

FRAMES = 8
RED = "\x1b[1;31m"


def test_a_run_in_which_nobody_is_tracked_says_so_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 3, a line in red, all files, and a chip in the report."""
    room = Room((CABINET,), noise=0.001)
    depth = np.array([room.see(None, number).view.depth for number in range(FRAMES)])
    sequence = write_open3d(tmp_path / "empty", depth, CAMERA)
    out = tmp_path / "run"
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["track", str(sequence), "--out", str(out), "--no-pictures"], Direct().connect) == 3
    said = capsys.readouterr().err
    red = [line for line in said.splitlines() if RED in line]
    assert any("most frames are not tracked (8 absent)" in line for line in red)
    assert "--rotate" not in said
    assert "waiting for a person" in said
    assert {"track.npz", "summary.json", "poses.csv"} <= {path.name for path in out.iterdir()}
    assert set(read_track(out).status) == {"absent"}
    assert main(["report", str(out)]) == 0
    assert "frames 0 to 7): absent" in (out / "report.html").read_text()


@pytest.mark.parametrize(("rotate", "is_told"), [("auto", True), ("0", False)])
def test_without_a_floor_a_line_asks_whether_the_camera_is_rotated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rotate: str, is_told: bool
) -> None:
    """Nobody is tracked, and up was guessed; not if the user said how the camera is rotated."""
    room = Room((CABINET,), noise=0.001)
    depth = np.array([room.see(None, number).view.depth for number in range(FRAMES)])
    depth[:, 85:] = 0  # the floor starts there
    sequence = write_open3d(tmp_path / "wall", depth, CAMERA)
    asked = ("--rotate", rotate, "--no-pictures")
    assert main(["track", str(sequence), "--out", str(tmp_path / "run"), *asked], Direct().connect) == 3
    line = "no floor was found; if the camera is rotated, give --rotate 90, 180 or 270"
    assert (line in " ".join(capsys.readouterr().err.split())) == is_told


@pytest.mark.parametrize("rotate", ["180", "auto"])
def test_a_camera_upside_down_is_turned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rotate: str
) -> None:
    """By --rotate, or detected, which a line says; with --rotate, exports know the vertical, too."""
    frame = shown("standing").frames[0]
    depth = np.repeat(frame.views[0].depth[None, ::-1, ::-1], 2, axis=0)
    camera = frame.views[0].intrinsics
    lens = (camera.fx, camera.fy, camera.width - 1 - camera.cx, camera.height - 1 - camera.cy)
    sequence = write_open3d(tmp_path / "turned", depth, type(camera)(camera.width, camera.height, *lens))
    out = tmp_path / "run"
    asked = ("--rotate", rotate, "--no-pictures")
    assert main(["track", str(sequence), "--out", str(out), *asked], Direct().connect) == 0
    line = "upright in images turned clockwise by 180 degrees; if that is wrong, give --rotate"
    assert (line in " ".join(capsys.readouterr().err.split())) == (rotate == "auto")
    summary, track = msgspec.json.decode((out / "summary.json").read_bytes()), read_track(out)
    assert summary["rotate_deg"] == 180
    head, pelvis = (track.joint_positions[-1, track.joint_names.index(name)] for name in ("head", "pelvis"))
    assert head[1] - pelvis[1] > 0.5
    assert (track.up is None) == (rotate == "auto")
    assert track.up is None or track.up @ (head - pelvis) > 0.5
