"""The command line from options to files, with particles that stay where they are in place of workers."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gepf.common.errors import BusError
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.cli import main
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.track import Track, read_track
from tests.support.stand_ins import Desk, desk, sequence, workers  # noqa: F401 fixtures

Tracked = Callable[..., tuple[Track, dict[str, Any]]]


@pytest.fixture
def tracked(desk: Desk) -> Tracked:
    """Track the sequence with options, and return track and summary."""

    def run(*options: str) -> tuple[Track, dict[str, Any]]:
        assert desk.track(*options) == 0
        return read_track(desk.out), desk.summary

    return run


def test_help_and_version_go_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    """They are no errors; gepf alone prints its help."""
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert all(command in out for command in ("demo", "track", "evaluate", "export", "synth"))
    assert main(["--version"]) == 0
    assert re.fullmatch(r"gepf \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_a_run_leaves_files_and_says_nothing_on_stdout(
    tracked: Tracked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All frames are in the files; progress is on stderr."""
    track, _ = tracked()
    assert track.frame.tolist() == [0, 1, 2, 3, 4]
    assert track.time_s.tolist() == [n / 30 for n in range(5)]
    files = ["model.npz", "person.json", "poses.csv", "summary.json", "track.npz"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == files
    out, err = capsys.readouterr()
    assert out == ""
    assert "frame 5 of 5" in err


def test_quiet_and_json_leave_a_program_what_it_reads(
    tracked: Tracked, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stdout is the summary as it is in the run's folder; nothing at all is on stderr, but for errors."""
    _, summary = tracked("--quiet", "--json")
    out, err = capsys.readouterr()
    assert json.loads(out) == summary
    assert err == ""
    assert main(["track", "nowhere", "--out", "x", "-q"]) == 2
    assert capsys.readouterr().err.startswith("gepf: no such file or folder: nowhere")


def test_the_summary_has_settings_and_outcome(tracked: Tracked, desk: Desk) -> None:
    """Settings, seed, versions, the pool that was asked for, workers, frames, particles, rate and times."""
    where = ("--listen", "tcp/127.0.0.1:7447", "--connect", "tcp/router:7447", "--insecure")
    workers = ("--workers", "3", "--worker-timeout", "9", "--kind", "cuda")
    _, summary = tracked("--particles", "7", "--points", "300", "--seed", "9", *workers, *where)
    pool = Pool(3, "tcp/127.0.0.1:7447", "tcp/router:7447", worker_timeout=9.0, kind="cuda")
    assert desk.workers.asked == pool
    asked = {name: getattr(pool, name) for name in ("workers", "listen", "connect", "worker_timeout")}
    settings: Any = summary["settings"]
    expected = {
        "sequence": "person",
        "complete": True,
        "method": "gepf",
        "preset": "default",
        "seed": 9,
        "frames": 5,
        "particles": 7,
        "worker_kind": "cuda",
        "workers_seen": ["one", "two"],
        "processors": ["zen3"],
        "batches_sent_again": 3,
        "pool": {**asked, "encrypted": False},
        "color": None,
    }
    assert {name: summary[name] for name in expected} == expected
    assert (settings["points"], settings["filter"]["particles"], settings["seed"]) == (300, 7, 9)
    assert {"python", "numpy", "numba", "eclipse-zenoh"} <= set(summary["versions"])
    assert {"segment", "refine", "merge"} <= set(summary["time_per_stage"])
    assert isinstance(summary["frame_rate"], float)


def test_settings_that_follow_from_the_body_are_stored(tracked: Tracked) -> None:
    """People wear clothes: what `summary.json` and the library's runs state is what the workers get."""
    _, summary = tracked()
    weight = summary["settings"]["refine"]["outside_weight"]
    assert weight == PEOPLE.outside_weight < 1.0


def test_the_seed_decides_the_bytes(desk: Desk, tmp_path: Path) -> None:
    """The same seed gives the same track, another seed another."""
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert desk.track("--seed", seed, out=tmp_path / name) == 0
    first, again, other = ((tmp_path / name / "track.npz").read_bytes() for name in "abc")
    assert first == again != other


def test_a_start_from_a_file_overrides_that_of_the_sequence(tracked: Tracked, tmp_path: Path) -> None:
    """Values that the file omits are zero."""
    (tmp_path / "start.json").write_text(json.dumps({"root_tz": 2.05}))
    track, _ = tracked("--method", "gradient", "--init", str(tmp_path / "start.json"))
    assert track.pose[0, track.dof_names.index("root_tz")] == 2.05
    assert track.pose[0, track.dof_names.index("r_elbow_flexion")] == 0.0


@pytest.mark.parametrize(
    ("failure", "code", "says"),
    [
        (KeyboardInterrupt(), 130, "gepf: stopped"),
        (BusError("the link is gone"), 1, "gepf: the link is gone"),
        (RuntimeError("a defect"), 1, "gepf: RuntimeError: a defect (gepf --debug shows the traceback)"),
    ],
)
def test_what_was_tracked_is_kept_however_a_run_ends(
    desk: Desk, failure: BaseException, code: int, says: str
) -> None:
    """Stopped by the user, the bus or a defect: two frames are there, and one line says why."""
    desk.fail(2, failure)
    assert desk.track() == code
    *_, early, last = desk.said()
    assert last == says
    assert early.startswith("ended early with 2 of 5 frames in ")
    assert read_track(desk.out).frame.tolist() == [0, 1]
    assert desk.summary["complete"] is False


def test_a_run_that_ends_before_its_first_frame_leaves_nothing(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No folder, one line; the trace before it only if it was asked for."""
    desk.fail(0, RuntimeError("a defect"))
    for debug in ("0", "1"):
        monkeypatch.setenv("GEPF_DEBUG", debug)
        assert desk.track(out=desk.out / "deep" / "run") == 1
        lines = desk.said()
        assert any("Traceback" in line for line in lines) == (debug == "1")
        assert lines[-1].startswith("gepf: RuntimeError: a defect")
        assert not desk.out.exists()
