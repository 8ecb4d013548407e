"""The command line from options to files, with particles that stay where they are in place of workers."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.errors import BusError
from coordinator.cli import main
from coordinator.pool.options import Pool
from coordinator.results.track import Track, read_track
from tests.support.stand_ins import StillWorkers, no_traces, sequence, workers  # noqa: F401 fixtures

pytestmark = pytest.mark.usefixtures("no_traces")

ARM = ("r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion")


def summary_of(out: Path) -> dict[str, Any]:
    """The summary of a run."""
    content: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return content


Tracked = Callable[..., tuple[Track, dict[str, Any]]]


@pytest.fixture
def tracked(sequence: Path, tmp_path: Path, workers: StillWorkers) -> Tracked:
    """Track the sequence with options, and return track and summary."""

    def run(*options: str) -> tuple[Track, dict[str, Any]]:
        assert workers.track(sequence, tmp_path / "out", *options) == 0
        return read_track(tmp_path / "out"), summary_of(tmp_path / "out")

    return run


def test_help_and_version_go_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    """They are no errors; gepf alone prints its help."""
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert all(command in out for command in ("demo", "track", "evaluate", "export", "synth"))
    assert main(["--version"]) == 0
    assert re.fullmatch(r"gepf \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_help_waits_for_no_library() -> None:
    """Libraries that load slowly are not loaded for a help page."""
    code = (
        "import sys; from coordinator.cli import main; main(['track', '--help']);"
        "sys.exit(' '.join({'numpy', 'numba', 'scipy', 'zenoh', 'matplotlib', 'open3d'}"
        " & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "--particles" in done.stdout


def test_a_run_leaves_files_and_says_nothing_on_stdout(
    tracked: Tracked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All frames are in the files; progress is on stderr."""
    track, _ = tracked()
    assert track.frame.tolist() == [0, 1, 2, 3, 4]
    assert track.time_s.tolist() == [n / 30 for n in range(5)]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "model.npz",
        "person.json",
        "poses.csv",
        "summary.json",
        "track.npz",
    ]
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


def test_a_frame_without_depth_shows_nobody_and_the_run_goes_on(tracked: Tracked) -> None:
    """With one particle that stays where it is: the pose is the start's, to the bit."""
    track, summary = tracked("--method", "gradient")
    assert (summary["particles"], track.hypothesis_pose.shape[1]) == (1, 1)
    assert track.pose[:, track.dof_names.index("r_elbow_flexion")].tolist() == [0.5] * 5
    assert track.status.tolist() == ["tracked", "tracked", "tracked", "absent", "tracked"]
    assert summary["status"] == {"tracked": 4, "ambiguous": 0, "lost": 0, "searching": 0, "absent": 1}


def test_the_summary_has_settings_and_outcome(tracked: Tracked, workers: StillWorkers) -> None:
    """Settings, seed, versions, the pool that was asked for, workers, frames, particles, rate and times."""
    where = ("--listen", "tcp/127.0.0.1:7447", "--connect", "tcp/router:7447", "--worker-timeout", "9")
    _, summary = tracked("--particles", "7", "--points", "300", "--seed", "9", "--workers", "3", *where)
    pool = Pool(3, "tcp/127.0.0.1:7447", "tcp/router:7447", worker_timeout=9.0)
    assert workers.asked == pool
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
        "workers_seen": ["one", "two"],
        "batches_sent_again": 3,
        "pool": {**asked, "encrypted": False},
        "color": None,
    }
    assert {name: summary[name] for name in expected} == expected
    assert (settings["points"], settings["filter"]["particles"], settings["seed"]) == (300, 7, 9)
    assert {"python", "numpy", "numba", "eclipse-zenoh"} <= set(summary["versions"])
    assert {"segment", "refine", "merge"} <= set(summary["time_per_stage"])
    assert isinstance(summary["frame_rate"], float)


def test_the_seed_decides_the_bytes(sequence: Path, tmp_path: Path, workers: StillWorkers) -> None:
    """The same seed gives the same track, another seed another."""
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert workers.track(sequence, tmp_path / name, "--seed", seed) == 0
    first, again, other = ((tmp_path / name / "track.npz").read_bytes() for name in "abc")
    assert first == again != other


def test_only_the_named_degrees_of_freedom_move(tracked: Tracked) -> None:
    """The rest, including the root, is held at the start pose from the sequence's own file."""
    track, summary = tracked("--dof", ",".join(ARM))
    assert track.dof_names == ARM
    pelvis = track.joint_positions[:, track.joint_names.index("pelvis")]
    np.testing.assert_allclose(pelvis, np.tile([0.0, 0.0, 2.0], (5, 1)), atol=0.05)
    assert np.ptp(pelvis, axis=0).max() == 0.0
    assert track.pose[0, 3] == pytest.approx(0.5, abs=0.5)
    assert summary["model"]["active"] == list(ARM)


def test_a_start_from_a_file_overrides_that_of_the_sequence(tracked: Tracked, tmp_path: Path) -> None:
    """Values that the file omits are zero."""
    (tmp_path / "start.json").write_text(json.dumps({"root_tz": 2.05}))
    track, _ = tracked("--method", "gradient", "--init", str(tmp_path / "start.json"))
    assert track.pose[0, track.dof_names.index("root_tz")] == 2.05
    assert track.pose[0, track.dof_names.index("r_elbow_flexion")] == 0.0


def test_a_range_of_frames_keeps_their_numbers(tracked: Tracked) -> None:
    """Half open, numbers and times as in the whole sequence."""
    track, _ = tracked("--frames", "1:3")
    assert track.frame.tolist() == [1, 2]
    assert track.time_s.tolist() == [1 / 30, 2 / 30]


@pytest.mark.parametrize(
    ("failure", "code", "says"),
    [
        (KeyboardInterrupt(), 130, "gepf: stopped"),
        (BusError("the link is gone"), 1, "gepf: the link is gone"),
        (RuntimeError("a defect"), 1, "gepf: RuntimeError: a defect (gepf --debug shows where)"),
    ],
)
def test_what_was_tracked_is_kept_however_a_run_ends(
    sequence: Path,
    tmp_path: Path,
    workers: StillWorkers,
    capsys: pytest.CaptureFixture[str],
    failure: BaseException,
    code: int,
    says: str,
) -> None:
    """Stopped by the user, the bus or a defect: two frames are there, and one line says why."""
    workers.fail_at, workers.failure = 2, failure
    assert workers.track(sequence, tmp_path / "out") == code
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == says
    assert lines[-2].startswith("ended early with 2 of 5 frames in ")
    assert read_track(tmp_path / "out").frame.tolist() == [0, 1]
    assert summary_of(tmp_path / "out")["complete"] is False


def test_a_run_that_ends_before_its_first_frame_leaves_nothing(
    sequence: Path,
    tmp_path: Path,
    workers: StillWorkers,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No folder, one line; the trace before it only if it was asked for."""
    workers.fail_at, workers.failure = 0, RuntimeError("a defect")
    for debug in ("0", "1"):
        monkeypatch.setenv("GEPF_DEBUG", debug)
        assert workers.track(sequence, tmp_path / "out") == 1
        err = capsys.readouterr().err
        assert ("Traceback" in err) == (debug == "1")
        assert err.splitlines()[-1].startswith("gepf: RuntimeError: a defect")
        assert not (tmp_path / "out").exists()


def test_evaluate_prints_one_object_that_a_program_reads(
    tracked: Tracked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stdout is JSON and nothing else; with the run's own poses as truth all errors are zero."""
    track, _ = tracked()
    capsys.readouterr()
    np.savez(
        tmp_path / "truth.npz",
        joint_names=np.array(track.joint_names),
        joint_positions=track.joint_positions,
        dof_names=np.array(track.dof_names),
        pose=track.pose,
    )
    assert main(["evaluate", str(tmp_path / "out"), "--truth", str(tmp_path / "truth.npz")]) == 0
    score = json.loads(capsys.readouterr().out)
    assert (score["mean_angle_error_deg"], score["mean_joint_error_cm"], score["pck10"]) == (0.0, 0.0, 1.0)
    assert (score["frames"], score["lost_from_frame"]) == (5, None)
    assert "root_rx" in score["mean_angle_error_deg_by_dof"]
    assert "root_tx" not in score["mean_angle_error_deg_by_dof"]
