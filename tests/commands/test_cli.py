"""The command line from options to files, with particles that stay where they are in place of workers."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common.errors import BusError
from coordinator.cli import main
from coordinator.pool.options import Pool
from coordinator.results.track import Track, read_track
from tests.support.stand_ins import StillWorkers, no_traces, sequence, workers  # noqa: F401 fixtures

pytestmark = pytest.mark.usefixtures("no_traces")

ARM = ("r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion")


def summary_of(out: Path) -> dict[str, object]:
    """The summary of a run."""
    content: dict[str, object] = json.loads((out / "summary.json").read_text())
    return content


Tracked = Callable[..., tuple[Track, dict[str, object]]]


@pytest.fixture
def tracked(sequence: Path, tmp_path: Path, workers: StillWorkers) -> Tracked:
    """Track the sequence with options, and give what came out."""

    def run(*options: str) -> tuple[Track, dict[str, object]]:
        assert workers.track(sequence, tmp_path / "out", *options) == 0
        return read_track(tmp_path / "out"), summary_of(tmp_path / "out")

    return run


def test_gepf_alone_prints_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    """Help goes to stdout and is no error."""
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for command in ("demo", "track", "evaluate", "export", "synth"):
        assert command in out


def test_help_waits_for_no_library() -> None:
    """What takes long to load is not loaded to print a page."""
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
    """Stdout is the summary as it is in the run's folder; nothing at all is on stderr."""
    _, summary = tracked("--quiet", "--json")
    out, err = capsys.readouterr()
    assert json.loads(out) == summary
    assert err == ""


def test_quiet_keeps_errors(
    sequence: Path, tmp_path: Path, workers: StillWorkers, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line says why, as ever."""
    assert (
        main(
            ["track", str(sequence), "--out", str(tmp_path / "x"), "-q", "--particles", "0"], workers.connect
        )
        == 2
    )
    assert capsys.readouterr().err.startswith("gepf: Invalid value for '--particles'")


def test_a_shell_completes_commands() -> None:
    """As the shell asks, by typer's variables."""
    asked = {**os.environ, "_GEPF_COMPLETE": "complete_bash", "COMP_WORDS": "gepf tr", "COMP_CWORD": "1"}
    code = "from coordinator.cli import main; main([])"
    done = subprocess.run(
        [sys.executable, "-c", code], env=asked, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["track"]


def test_a_frame_without_depth_shows_nobody_and_the_run_goes_on(tracked: Tracked) -> None:
    """Nothing can be said of the frame in which nothing is seen; the next is tracked again."""
    track, summary = tracked("--method", "gradient")
    assert track.status.tolist() == ["tracked", "tracked", "tracked", "absent", "tracked"]
    assert summary["status"] == {"tracked": 4, "ambiguous": 0, "lost": 0, "searching": 0, "absent": 1}


def test_the_summary_has_settings_and_outcome(tracked: Tracked) -> None:
    """Settings, seed, versions, workers, batches sent again, frames, particles, rate and times."""
    _, summary = tracked(
        "--particles", "7", "--points", "300", "--seed", "9", "--preset", "default", "--workers", "3"
    )
    assert summary["sequence"] == "person"
    assert summary["complete"] is True
    assert (summary["method"], summary["preset"], summary["seed"]) == ("gepf", "default", 9)
    assert (summary["frames"], summary["particles"]) == (5, 7)
    assert (summary["workers_seen"], summary["batches_sent_again"]) == (["one", "two"], 3)
    settings, versions, stages = summary["settings"], summary["versions"], summary["time_per_stage"]
    assert isinstance(settings, dict)
    assert isinstance(versions, dict)
    assert isinstance(stages, dict)
    assert (settings["points"], settings["filter"]["particles"], settings["seed"]) == (300, 7, 9)
    assert {"python", "numpy", "numba", "eclipse-zenoh"} <= set(versions)
    assert {"segment", "refine", "merge"} <= set(stages)
    assert isinstance(summary["frame_rate"], float)


def test_the_pool_is_asked_for_as_the_options_say(tracked: Tracked, workers: StillWorkers) -> None:
    """Workers and endpoints are passed on as they are."""
    tracked("--workers", "0", "--listen", "tcp/127.0.0.1:7447", "--connect", "tcp/router:7447")
    assert workers.asked == Pool(0, "tcp/127.0.0.1:7447", "tcp/router:7447")


def test_the_summary_has_the_pool_that_was_asked_for(tracked: Tracked) -> None:
    """As the other options; of certificates only that there are some."""
    _, summary = tracked("--workers", "3", "--listen", "tcp/127.0.0.1:7447", "--worker-timeout", "9")
    assert summary["pool"] == {
        "workers": 3,
        "listen": "tcp/127.0.0.1:7447",
        "connect": None,
        "worker_timeout": 9.0,
        "encrypted": False,
    }
    assert summary["color"] is None


def test_the_seed_decides_the_bytes(sequence: Path, tmp_path: Path, workers: StillWorkers) -> None:
    """The same seed gives the same track, another seed another."""
    written = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert (
            main(
                ["track", str(sequence), "--out", str(tmp_path / name), "--no-pictures", "--seed", seed],
                workers.connect,
            )
            == 0
        )
        written.append((tmp_path / name / "track.npz").read_bytes())
    assert written[0] == written[1]
    assert written[0] != written[2]


def test_only_the_named_degrees_of_freedom_move(tracked: Tracked) -> None:
    """The rest, the root too, is held at the start's pose, which the sequence's own file gives."""
    track, summary = tracked("--dof", ",".join(ARM))
    assert track.dof_names == ARM
    pelvis = track.joint_positions[:, track.joint_names.index("pelvis")]
    np.testing.assert_allclose(pelvis, np.tile([0.0, 0.0, 2.0], (5, 1)), atol=0.05)
    assert np.ptp(pelvis, axis=0).max() == 0.0
    assert track.pose[0, 3] == pytest.approx(0.5, abs=0.5)
    assert isinstance(summary["model"], dict)
    assert summary["model"]["active"] == list(ARM)


def test_gradient_is_one_particle_without_noise(tracked: Tracked) -> None:
    """With particles that stay where they are, the pose is the start's, to the bit."""
    track, summary = tracked("--method", "gradient")
    assert summary["particles"] == 1
    assert track.hypothesis_pose.shape[1] == 1
    assert track.pose[:, track.dof_names.index("r_elbow_flexion")].tolist() == [0.5] * 5


@pytest.mark.parametrize(("method", "particles"), [("condensation", 1000), ("annealed", 100)])
def test_baselines_only_assess_and_bound_what_they_record(
    tracked: Tracked, method: str, particles: int
) -> None:
    """Workers are asked for no descent; of many particles at most a hundred are recorded."""
    track, summary = tracked("--method", method, "--dof", ",".join(ARM))
    assert (summary["method"], summary["particles"]) == (method, particles)
    assert isinstance(summary["settings"], dict)
    assert summary["settings"]["refine"]["icp_iterations"] == 0
    assert track.hypothesis_pose.shape[1] == 100
    np.testing.assert_allclose(track.hypothesis_weight, 0.01)


def test_a_start_from_a_file_overrides_that_of_the_sequence(tracked: Tracked, tmp_path: Path) -> None:
    """What the file does not name is zero."""
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
    sequence: Path, tmp_path: Path, workers: StillWorkers, capsys: pytest.CaptureFixture[str]
) -> None:
    """No folder, one line."""
    workers.fail_at, workers.failure = 0, BusError("nobody came")
    assert workers.track(sequence, tmp_path / "out") == 1
    assert not (tmp_path / "out").exists()
    assert capsys.readouterr().err.splitlines()[-1] == "gepf: nobody came"


def test_debugging_shows_where_an_error_arose(
    sequence: Path,
    tmp_path: Path,
    workers: StillWorkers,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The trace comes before the line, and only if asked for."""
    monkeypatch.setenv("GEPF_DEBUG", "1")
    workers.fail_at, workers.failure = 0, RuntimeError("a defect")
    assert workers.track(sequence, tmp_path / "out") == 1
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.splitlines()[-1].startswith("gepf: RuntimeError: a defect")


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
    assert set(score) == {
        "mean_angle_error_deg",
        "mean_angle_error_deg_by_dof",
        "best_hypothesis_angle_error_deg",
        "best_hypothesis_angle_error_deg_by_dof",
        "mean_angle_error_deg_by_angle",
        "worst_angle_error_deg_by_angle",
        "mean_slide_error_cm_by_dof",
        "mean_joint_error_cm",
        "within_deviation",
        "within_two_deviations",
        "pck10",
        "lost_from_frame",
        "frames",
    }
    assert (score["mean_angle_error_deg"], score["mean_joint_error_cm"], score["pck10"]) == (0.0, 0.0, 1.0)
    assert (score["frames"], score["lost_from_frame"]) == (5, None)
    assert "root_rx" in score["mean_angle_error_deg_by_dof"]
    assert "root_tx" not in score["mean_angle_error_deg_by_dof"]


def test_export_writes_the_file_that_was_asked_for(tracked: Tracked, tmp_path: Path) -> None:
    """CSV as in the run's own folder."""
    tracked()
    assert main(["export", str(tmp_path / "out"), "--to", "csv", "--out", str(tmp_path / "x.csv")]) == 0
    assert (tmp_path / "x.csv").read_bytes() == (tmp_path / "out" / "poses.csv").read_bytes()


def test_the_version_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """`gepf --version` prints what is installed, and does nothing else."""
    assert main(["--version"]) == 0
    assert re.fullmatch(r"gepf \d+\.\d+\.\d+\n", capsys.readouterr().out)
