"""A loaded run: values by name, smoothing, export, saving, and the public names."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import gepf
from tests.support.bodies import person
from tests.support.people import SETTINGS, STANDING, shown
from tests.support.runs import swing, write_run

PERSON = gepf.Measures.of(1.82)


@pytest.fixture
def run(tmp_path: Path) -> gepf.Run:
    """A run of 30 frames, the third lost."""
    body = person()
    write_run(tmp_path / "run", body, swing(body, 30), lost=(2,))
    (tmp_path / "run" / "summary.json").write_text('{"sequence": "swing"}')
    return gepf.load(tmp_path / "run")


def test_angles_by_any_of_their_names(run: gepf.Run) -> None:
    """Plain, MPEG-4's and the ISB's, in radians or degrees; the error of an unknown name lists the known."""
    plain, mpeg4 = run.angle("right_elbow_flexion"), run.angle("r_elbow_flexion")
    known = np.arange(30) != 2  # where it is lost, only the pose keeps the guess
    assert np.allclose(plain[known], mpeg4[known], atol=1e-9)
    assert np.array_equal(run.angle("right_elbow_flexion", degrees=True), np.degrees(plain))
    assert run.angle("left_shoulder_isb_elevation").shape == (30,)
    assert {"left_shoulder_isb_elevation"} < set(run.isb_angle_names)
    assert run.angle_deviation("right_elbow_flexion", degrees=True)[0] == pytest.approx(5.0)
    assert np.isnan(run.angle_deviation("right_elbow_flexion")[2])
    with pytest.raises(gepf.InputError, match="unknown angle 'elbow'; choose from pelvis_forward_tilt,"):
        run.angle("elbow")


def test_joints_by_name(run: gepf.Run) -> None:
    """Places (F, 3), and what else a run knows of frames; the error of an unknown joint lists the known."""
    at = run.joint_names.index("right_wrist")
    assert np.array_equal(run.joint("right_wrist"), run.track.joint_positions[:, at])
    assert (len(run), run.status[2], run.frame[0], run.summary["sequence"]) == (30, "lost", 100, "swing")
    assert np.isnan(run.joint_deviation("right_wrist")).all()  # this run was written without
    with pytest.raises(gepf.InputError, match="unknown joint 'hand'; choose from pelvis, neck"):
        run.joint("hand")


def test_a_data_frame_holds_the_csv(run: gepf.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """One row a frame, angles in degrees first, with their times; a missing package is named."""
    table = run.to_dataframe()
    assert np.allclose(table["right_elbow_flexion_deg"], run.angle("right_elbow_flexion", degrees=True))
    assert np.allclose(table["time_s"], run.time_s)
    assert len(table) == 30
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(gepf.InputError, match=r"needs the package pandas, .* pip install 'gepf\[tables\]'"):
        run.to_dataframe()


def test_exports_by_suffix(run: gepf.Run, tmp_path: Path) -> None:
    """The format follows the suffix; a smoothed run is smoothed there."""
    path = run.export(tmp_path / "angles.mot")
    assert "inDegrees=yes" in path.read_text()
    with pytest.raises(gepf.InputError, match="force"):
        run.export(path)
    run.smooth(6.0).export(path, force=True)
    assert "low pass 6 Hz" in path.read_text()


def test_smoothing_leaves_the_run_as_it_was(run: gepf.Run) -> None:
    """Another run with less motion from frame to frame; the one in hand and its folder keep theirs."""
    before = run.angle("left_knee_flexion")
    smooth = run.smooth(3.0).angle("left_knee_flexion")
    assert not np.array_equal(smooth, before)
    assert np.array_equal(gepf.load(run.folder).angle("left_knee_flexion"), before)


def test_plot_and_report(run: gepf.Run) -> None:
    """A figure with a plot for each angle that was asked for; a page in the run's folder."""
    figure = run.plot(["right_knee_flexion", "left_knee_flexion"])
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["right knee flexion", "left knee flexion"]
    assert run.report() == run.folder / "report.html"
    assert "Range of motion" in (run.folder / "report.html").read_text()


def test_estimates_are_asked_by_name_and_saved(tmp_path: Path) -> None:
    """An estimate is read by name; saved estimates are the run that `load` returns."""
    tracker = gepf.Tracker(PERSON, SETTINGS, start=STANDING)
    estimates = [tracker.track(frame) for frame in shown("standing").frames[:2]]
    first = estimates[0]
    at = first.model.joint_names.index("right_wrist")
    assert np.array_equal(first.joint("right_wrist"), first.joint_positions[at])
    assert 0.0 < first.joint_deviation("head") < 0.5
    elbow = first.angle("right_elbow_flexion", degrees=True)
    assert elbow == pytest.approx(np.degrees(first.angle("r_elbow_flexion")))
    run = gepf.load(tracker.save(estimates, tmp_path / "saved"))
    assert run.angle("r_elbow_flexion", degrees=True)[0] == pytest.approx(elbow)
    assert run.angle("right_elbow_flexion", degrees=True)[0] == pytest.approx(elbow, abs=0.1)  # evened out
    assert run.summary["status"]["tracked"] == 2
    run.report()
    with pytest.raises(gepf.InputError, match="already holds a run"):
        tracker.save(estimates, tmp_path / "saved")
    with pytest.raises(gepf.InputError, match="nothing to save"):
        tracker.save([], tmp_path / "empty")


def test_nothing_private_shows() -> None:
    """`dir(gepf)` lists the documented names, and each exists."""
    assert dir(gepf) == sorted(gepf.__all__)
    assert all(hasattr(gepf, name) for name in gepf.__all__)


def test_the_library_tells_its_version() -> None:
    """`gepf.__version__` is the version of the installed package."""
    assert gepf.__version__ == metadata.version("gepf")


def test_nothing_is_known_before_the_first_detection(tmp_path: Path) -> None:
    """Angles, joints and poses are NaN there, and in the frames after it they are not."""
    model = person()
    poses = swing(model, 4)
    poses[0] = np.nan
    write_run(tmp_path / "run", model, poses, lost=(0,))
    run = gepf.load(tmp_path / "run")
    assert run.placed.tolist() == [False, True, True, True]
    angles = run.angle("right_elbow_flexion")
    for values in (
        angles,
        run.joint("right_wrist")[:, 0],
        run.angle("r_elbow_flexion"),
        run.track.pose[:, 0],
    ):
        assert np.isfinite(values).tolist() == run.placed.tolist()
    assert run.to_dataframe()["right_elbow_flexion_deg"].isna().tolist() == (~run.placed).tolist()
    run.plot(["right_elbow_flexion"])
