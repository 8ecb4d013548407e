"""Messages of commands: at once, with the valid choices, and after an interrupt."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gepf.coordinator.cli import main
from tests.support.processes.programs import GEPF
from tests.support.stand_ins import Desk, desk, sequence, workers  # noqa: F401 fixtures

ENDED = (130, -signal.SIGINT)  # to a shell the same: `python -m` passes a signal on that came in an import


@pytest.fixture
def tracked(desk: Desk) -> Path:
    """A finished run without pictures."""
    assert desk.track() == 0
    return desk.out


def test_every_command_says_that_a_killed_run_can_be_continued(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For a folder with a log and without results: exit code 2, and what to do."""
    run = tmp_path / "killed"
    run.mkdir()
    (run / "frames.log").write_bytes(b"frames")
    for command in (
        ("report", "{run}"),
        ("evaluate", "{run}", "--truth", "{run}/track.npz"),
        ("export", "{run}", "--to", "csv", "--out", "{run}/x.csv"),
        ("view", "{run}", "--save", "{run}/x.rrd"),
        ("pictures", "{run}"),
    ):
        assert main([word.format(run=run) for word in command]) == 2
        said = capsys.readouterr().err
        assert "was interrupted; finish it with the same gepf track command and --resume" in said


def test_results_of_a_part_of_a_run_are_said_to_be_that(
    desk: Desk, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A run that ended early is exported, with a warning."""
    desk.fail(2)
    assert desk.track() == 130
    assert main(["export", str(desk.out), "--to", "csv", "--out", str(tmp_path / "part.csv")]) == 0
    assert "until gepf track --resume finishes" in caplog.text


def test_track_says_what_it_does_before_it_loads_what_takes_long(sequence: Path, tmp_path: Path) -> None:
    """Its first line comes before the compiler and matplotlib are loaded; an interrupt then ends it."""
    program = (sys.executable, "-X", "importtime", *GEPF[1:])  # each module that was loaded, a line
    with subprocess.Popen(
        [*program, "track", str(sequence), "--out", str(tmp_path / "out")], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        loaded = []
        while (line := process.stderr.readline()).startswith("import time:"):
            loaded.append(line.rsplit("|", 1)[1].strip())
        process.send_signal(signal.SIGINT)
        process.stderr.read()
    assert re.match(rf"tracking .*{sequence.name} into .*out", line)
    assert process.returncode in ENDED
    assert "gepf.coordinator.cli" in loaded
    assert not {"numba", "open3d", "matplotlib"} & set(loaded)


@pytest.mark.parametrize(
    ("line", "unused"),
    [
        ("export RUN --to csv --out RUN/x.csv", "numba matplotlib scipy.signal"),
        ("report RUN", "numba scipy"),
        ("evaluate RUN --truth RUN/none.npz", "open3d matplotlib"),
        ("model dofs", "numba scipy"),
        ("pictures RUN/none", "matplotlib"),
        ("track --help", "numpy numba scipy zenoh matplotlib open3d"),
    ],
)
def test_short_commands_load_what_they_need_alone(tracked: Path, line: str, unused: str) -> None:
    """Loading is most of their time: without the compiler, filters and figures it is under a second."""
    code = (
        "import sys; from gepf.coordinator.cli import main; "
        f"main({line.replace('RUN', str(tracked)).split()!r});"
        f"sys.exit(' '.join(set({unused.split()!r}) & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_run_without_pictures_says_how_to_draw_them(
    tracked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--no-pictures; then gepf pictures draws, and says what it wrote."""
    assert f"gepf pictures {tracked} draws pictures" in " ".join(capsys.readouterr().err.split())
    assert not list(tracked.glob("*.mp4"))
    assert main(["pictures", str(tracked)]) == 0
    assert "pictures are in" in capsys.readouterr().err
    assert {path.name for path in tracked.iterdir()} >= {"overlay.mp4", "sheet.png", "hypotheses.png"}
