"""Live runs that are killed, over the real bus, and live runs without a folder."""

from __future__ import annotations

import json
from itertools import count
from pathlib import Path

import pytest

from gepf.common.protocol.frames import encode_live
from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from tests.support.live import (
    KEY,
    at_work,
    plate_image,
    publishing,
    recorded_frames,
    recording,  # noqa: F401 a fixture
    summary_of,
    tracking,
    until_recorded,
)
from tests.support.processes.programs import wait_until
from tests.support.processes.warm_processes import gepf, started


def test_a_killed_live_run_is_exported_and_reported(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """`gepf track zenoh:`, which is killed by SIGKILL while frames come: all frames that it had recorded.

    A second run in its folder is refused first. The first command that reads it finishes it and says so.
    """
    run, log = tmp_path / "run", tmp_path / "run" / "live.mcap"
    track = tracking(f"zenoh:{KEY}", run, "--no-pictures", listen=endpoint)
    with at_work(endpoint), started(gepf, *track, log=tmp_path / "log") as tracker:
        frames = ({KEY: encode_live(plate_image(number))} for number in count())
        with publishing(endpoint, [KEY], frames, until_recorded(run)):
            wait_until(lambda: log.exists() and recorded_frames(run) > 4, 300.0)
            tracker.kill()
            tracker.join()
    kept = recorded_frames(run)
    assert main(track) == 2
    assert (
        f"{run} holds a live run that was killed; finish it with gepf report {run}" in capsys.readouterr().err
    )
    csv = tmp_path / "run.csv"
    assert main(["export", str(run), "--to", "csv", "--out", str(csv)]) == 0
    assert caplog.messages == [f"the live run in {run} was killed; its {kept} frames are now in its results"]
    assert main(["report", str(run)]) == 0
    assert main(["info", str(run), "--json"]) == 0
    assert len(caplog.messages) == 1
    assert json.loads(capsys.readouterr().out)["frames"] == kept
    assert len(csv.read_text().splitlines()) == kept + 1
    assert len(read_track(run).frame) == kept
    summary = summary_of(run)
    assert (summary["complete"], summary["frames"], summary["pool"]["listen"]) == (False, kept, endpoint)
    assert (run / "report.html").exists()
    assert not log.exists()


def test_a_live_run_needs_no_folder(endpoint: str, recording: Path, tmp_path: Path) -> None:
    """Its results are only published; a line says so, and its end how many frames were tracked."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    track = tracking(f"zenoh:{KEY}", folder / "run", "--no-pictures", listen=endpoint)
    at = track.index("--out")
    play = ["publish", str(recording), "--key", KEY, "--connect", endpoint, "--frames", "0:6"]
    with (
        at_work(endpoint),
        started(gepf, *track[:at], *track[at + 2 :], log=tmp_path / "log") as tracker,
        started(gepf, *play, log=tmp_path / "publisher") as publisher,
    ):
        for process in (publisher, tracker):
            process.join()
            assert process.exitcode == 0
    said = (tmp_path / "log").read_text()
    stored = f"results are published on {KEY}/results, not stored (--out DIR stores them)"
    assert f"listening on {KEY}; {stored}\n" in said
    assert " frames were tracked, but not stored: " in said
    assert sorted(path.name for path in folder.iterdir()) == ["init.json", "plate.urdf"]


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("track {recording}", "the results of a recording need a folder; add --out DIR"),
        ("track zenoh:camera --json --listen {endpoint}", "--json prints the summary of stored results"),
        (
            "track zenoh:camera --out {recording}/run --resume --listen {endpoint}",
            "--resume is for recorded sequences; finish a killed live run with gepf report",
        ),
    ],
)
def test_what_a_live_run_and_a_recording_differ_in_is_said(
    endpoint: str, recording: Path, capsys: pytest.CaptureFixture[str], command: str, says: str
) -> None:
    """Exit code 2, and one line with the remedy."""
    words = command.format(recording=recording, endpoint=endpoint).split()
    assert main([*words, "--insecure"] if "--listen" in words else words) == 2
    assert says in capsys.readouterr().err
