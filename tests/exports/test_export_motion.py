"""MOT and C3D, read by OpenSim and by an independent C3D reader; and the low pass."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.common.kinematics import joint_positions
from gepf.coordinator.cli import main
from gepf.coordinator.exports import export_run
from gepf.coordinator.exports.axes import CAMERA_TO_OPENSIM
from gepf.coordinator.exports.recorded import read_run
from gepf.coordinator.exports.smoothing import smooth_track
from gepf.coordinator.results.track import Track, write_track
from tests.support.bodies import hinges, person
from tests.support.export_readers import c3d_points
from tests.support.runs import RATE, swing, write_and_export, write_run


def opensim_table(path: Path) -> tuple[list[str], Array, Array]:
    """Labels, times (F,) and values (F, C) of a motion file as OpenSim reads it."""
    opensim = pytest.importorskip("opensim", reason="OpenSim's package exists for Linux on x86-64 only")
    table = opensim.TimeSeriesTable(str(path))
    labels = list(table.getColumnLabels())
    assert table.getTableMetaDataString("inDegrees") == "yes"
    values = np.stack([table.getDependentColumn(name).to_numpy() for name in labels], axis=1)
    return labels, np.array(table.getIndependentColumn()), values


def test_opensim_reads_the_angles(tmp_path: Path) -> None:
    """Every angle in degrees under its plain name, at its frame's time; lost frames are omitted."""
    _, file = write_and_export(tmp_path, "mot", person(), 20, lost=(3,))
    labels, times, values = opensim_table(file)
    run, kept = read_run(tmp_path / "run"), np.arange(20) != 3
    assert labels[: len(run.track.angle_names)] == list(run.track.angle_names)
    assert np.allclose(times, run.track.time_s[kept])
    assert np.allclose(values[:, : len(run.track.angle_names)], np.degrees(run.track.angle)[kept], atol=1e-6)


def test_opensims_coordinates_turn_as_its_model_does(tmp_path: Path) -> None:
    """Applied about Z, X, Y along its chain, OpenSim's coordinates give the direction of both thighs."""
    body = person()
    track, file = write_and_export(tmp_path, "mot", body, 20)
    labels, _, values = opensim_table(file)
    joints = joint_positions(body, track.pose) @ CAMERA_TO_OPENSIM.T

    def turn(*names: str) -> Rotation:
        return Rotation.from_euler("ZXY", values[:, [labels.index(name) for name in names]], degrees=True)

    pelvis = turn("pelvis_tilt", "pelvis_list", "pelvis_rotation")
    for side, s, out in (("right", "r", 1.0), ("left", "l", -1.0)):
        hip = turn(f"hip_flexion_{s}", f"hip_adduction_{s}", f"hip_rotation_{s}")
        rest = joint_positions(body, np.zeros_like(track.pose[:1]))[0] @ CAMERA_TO_OPENSIM.T
        at = [body.joint_names.index(f"{side}_{name}") for name in ("hip", "knee")]
        thigh = hip.apply((rest[at[1]] - rest[at[0]]) * [1.0, 1.0, out])
        found = pelvis.apply(thigh * [1.0, 1.0, out])
        assert np.allclose(found, joints[:, at[1]] - joints[:, at[0]], atol=1e-6)


def test_opensims_inverse_kinematics_takes_the_markers(tmp_path: Path) -> None:
    """Its tool, on the file as it is, puts free bodies on the joints, as far apart as in the run."""
    opensim = pytest.importorskip("opensim", reason="OpenSim's package exists for Linux on x86-64 only")
    opensim.Logger.removeFileSink()
    track, file = write_and_export(tmp_path, "trc", person(), 10)
    model = opensim.Model()
    for name in track.joint_names:
        free = opensim.Body(f"{name}_body", 1.0, opensim.Vec3(0), opensim.Inertia(1))
        model.addBody(free)
        model.addJoint(opensim.FreeJoint(name, model.getGround(), free))
        model.addMarker(opensim.Marker(name, free, opensim.Vec3(0)))
    model.finalizeConnections()
    tool = opensim.InverseKinematicsTool()
    tool.setModel(model)
    tool.setMarkerDataFileName(str(file))
    tool.setStartTime(float(track.time_s[0]))
    tool.setEndTime(float(track.time_s[-1]))
    tool.setResultsDir(str(tmp_path))
    tool.setOutputMotionFileName(str(tmp_path / "ik.mot"))
    assert tool.run()
    labels, _, values = opensim_table(tmp_path / "ik.mot")
    columns = [[labels.index(f"{name}_coord_{axis}") for axis in (3, 4, 5)] for name in track.joint_names]
    found = values[:, np.array(columns)]
    apart, truth = (
        np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) for p in (found, track.joint_positions)
    )
    np.testing.assert_allclose(apart, truth, atol=1e-4)


@pytest.mark.parametrize("lost", [(2,), (0, 3, 4), (9,), ()], ids=str)
def test_opensim_reads_markers_with_lost_frames(tmp_path: Path, lost: tuple[int, ...]) -> None:
    """Wherever frames are lost, every frame keeps its time; only the lost ones have no markers."""
    opensim = pytest.importorskip("opensim", reason="OpenSim's package exists for Linux on x86-64 only")
    opensim.Logger.removeFileSink()
    track, file = write_and_export(tmp_path, "trc", person(), 10, lost)
    table = opensim.TimeSeriesTableVec3(str(file))
    assert list(table.getColumnLabels()) == list(track.joint_names)
    np.testing.assert_allclose(table.getIndependentColumn(), track.time_s, atol=1e-6)
    columns = [table.getDependentColumn(name) for name in track.joint_names]
    found = np.array([[column[f].to_numpy() for column in columns] for f in range(10)])  # (F, J, 3)
    kept = np.setdiff1d(np.arange(10), lost)
    assert np.isnan(found[list(lost)]).all()
    expected = track.joint_positions @ CAMERA_TO_OPENSIM.T * 1000.0
    assert np.abs(found[kept] - expected[kept]).max() < 0.01
    assert opensim.MarkerData(str(file)).getNumFrames() == 10


@pytest.mark.parametrize("smooth", [None, 6.0])
def test_repeated_stamps_become_evenly_spaced_times(tmp_path: Path, smooth: float | None) -> None:
    """If two images have each stamp, OpenSim reads both, the C3D has a slot for both, at their mean rate."""
    track = write_run(tmp_path / "run", person(), swing(person(), 20), times=np.arange(20) // 2 / 10.0)
    for form in ("mot", "trc", "c3d"):
        export_run(tmp_path / "run", form, tmp_path / f"run.{form}", smooth_hz=smooth)
    np.testing.assert_allclose(opensim_table(tmp_path / "run.mot")[1], np.arange(20) / 20.0, atol=1e-6)
    opensim = pytest.importorskip("opensim", reason="OpenSim's package exists for Linux on x86-64 only")
    markers = opensim.TimeSeriesTableVec3(str(tmp_path / "run.trc"))
    np.testing.assert_allclose(markers.getIndependentColumn(), np.arange(20) / 20.0, atol=1e-6)
    _, points, rate = c3d_points(tmp_path / "run.c3d")
    assert (len(points), rate) == (20, 20.0)
    assert np.all(points[:, : len(track.joint_names), 3] >= 0.0)


def test_a_c3d_reader_finds_joints_and_angles(tmp_path: Path) -> None:
    """Joints in millimetres with their deviation as residual, angles beside them, gaps without values."""
    body = person()
    poses = swing(body, 12)
    track = write_run(tmp_path / "run", body, poses, lost=(4,))
    with_gap = np.arange(12) != 7
    write_run(tmp_path / "gap", body, poses[with_gap], lost=(4,), frames=np.flatnonzero(with_gap))
    export_run(tmp_path / "gap", "c3d", tmp_path / "run.c3d")
    labels, points, rate = c3d_points(tmp_path / "run.c3d")
    assert labels[: len(track.joint_names)] == list(track.joint_names)
    assert rate == RATE
    assert len(points) == 12
    seen = np.setdiff1d(np.arange(12), [4, 7])
    places = track.joint_positions[seen] @ CAMERA_TO_OPENSIM.T * 1000.0
    assert np.allclose(points[seen, : len(track.joint_names), :3], places, atol=0.01)
    assert np.all(points[[4, 7], :, 3] == -1.0)
    elbow = points[seen, labels.index("right_elbow_flexion"), 0]
    assert np.allclose(elbow, np.degrees(track.pose[seen, body.dof("r_elbow_flexion")]), atol=1e-3)
    held = read_run(tmp_path / "gap")
    hip = held.track.angle[[0, 1, 2, 3, 5, 6, 7, 8, 9, 10]][
        :, [held.track.angle_names.index(f"left_hip_{n}") for n in ("flexion", "abduction", "rotation")]
    ]
    assert np.allclose(points[seen, labels.index("left_hip_angles"), :3], np.degrees(hip), atol=1e-3)


def test_a_robot_has_mot_and_c3d_too(tmp_path: Path) -> None:
    """A body without anatomy has its joints' own angles in both, and no coordinates of a person's model."""
    body = hinges()
    track, file = write_and_export(tmp_path, "mot", body, 5)
    export_run(tmp_path / "run", "c3d", tmp_path / "run.c3d")
    labels, _, values = opensim_table(file)
    assert labels == ["upper", "lower"]
    assert np.allclose(values, np.degrees(track.pose), atol=1e-6)
    assert set(labels) < set(c3d_points(tmp_path / "run.c3d")[0])


def test_the_cut_off_is_where_half_the_power_is_left(tmp_path: Path) -> None:
    """Both passes together leave 71 % of a sine at the cut-off, as is usual in laboratories, and no delay."""
    body = hinges()
    t = np.arange(400) / RATE
    poses = np.stack([np.sin(2.0 * np.pi * 3.0 * t), np.zeros_like(t)], axis=1)
    write_run(tmp_path / "run", body, poses)
    run = read_run(tmp_path / "run", smooth_hz=3.0)
    np.testing.assert_allclose(run.track.angle[100:300, 0], np.sqrt(0.5) * poses[100:300, 0], atol=0.02)
    np.testing.assert_allclose(run.track.pose, run.track.angle, atol=1e-9)


@pytest.mark.parametrize("status", ["lost", "searching", "absent"])
def test_frames_whose_pose_is_not_known_do_not_bend_their_neighbours(tmp_path: Path, status: str) -> None:
    """Their values are ignored, even more than a turn: the result is as if the motion had continued."""
    body = hinges()
    poses = np.full((60, 2), 0.3)
    poses[30:33] = [[3.0], [5.8], [8.4]]
    write_run(tmp_path / "run", body, poses, lost=(30, 31, 32), status=status)
    smooth = read_run(tmp_path / "run", smooth_hz=5.0)
    assert np.allclose(smooth.track.angle, 0.3, atol=1e-6)
    assert np.allclose(smooth.track.pose, 0.3, atol=1e-6)


def test_balls_are_low_passed_as_rotations(tmp_path: Path) -> None:
    """A shoulder that is still at an Euler singularity, given on either branch, stays where it is."""
    body = person()
    poses, first = np.zeros((20, len(body.dof_names))), body.dof("l_shoulder_flexion")
    poses[:, first : first + 3] = np.radians([[10.0, 88.0, 20.0], [190.0, 92.0, 200.0]] * 10)
    poses[:, body.dof("l_elbow_flexion")] = 1.0
    track = smooth_track(write_run(tmp_path / "run", body, poses), body, 6.0)
    assert np.allclose(joint_positions(body, track.pose), joint_positions(body, poses), atol=1e-6)


def test_a_cut_off_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    """A cut-off above half the rate, and a run of two frames."""
    body = hinges()
    write_run(tmp_path / "run", body, swing(body, 9))
    run = read_run(tmp_path / "run")
    with pytest.raises(InputError, match=r"12\.5 Hz, half the frame rate; try 6"):
        smooth_track(run.track, body, 20.0)
    write_run(tmp_path / "short", body, swing(body, 2))
    with pytest.raises(InputError, match="cannot be smoothed"):
        read_run(tmp_path / "short", smooth_hz=6.0)


def test_what_is_there_stays_unless_forced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An existing file is an error that names --force; with it, a line says what was written."""
    body = hinges()
    write_run(tmp_path / "run", body, swing(body, 9), lost=(2,))
    out = tmp_path / "angles.csv"
    out.write_text("mine")
    command = ["export", str(tmp_path / "run"), "--to", "csv", "--out", str(out)]
    assert main(command) == 2
    assert "already exists; replace it with --force" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert main([*command, "--smooth", "6", "--force"]) == 0
    written = capsys.readouterr()
    said = " ".join(written.err.split())
    assert written.out == ""
    assert "9 frames, 1 of them lost, low pass 6 Hz" in said
    head = out.read_text().splitlines()[0].split(",")
    assert "upper_deg" in head


def test_frames_before_a_person_was_found_are_empty_in_csv_and_json(tmp_path: Path) -> None:
    """Their values are not known: NaN as in the run's own CSV, null in JSON; also with the low pass."""
    body = hinges()
    track = write_run(tmp_path / "run", body, swing(body, 9), lost=(0, 1))
    for values in (track.pose, track.joint_positions, track.hypothesis_pose, track.hypothesis_weight):
        values[:2] = np.nan
    with (tmp_path / "run" / "track.npz").open("wb") as file:
        write_track(track, file)
    for smooth in (None, 6.0):
        export_run(tmp_path / "run", "csv", tmp_path / "a.csv", smooth_hz=smooth)
        head, *lines = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()]
        places = [head.index(name) for name in ("upper_deg", "upper")]
        assert [[line[at] for at in places] for line in lines[:2]] == [["nan", "nan"]] * 2
        assert all("nan" not in [line[at] for at in places] for line in lines[2:])
        export_run(tmp_path / "run", "json", tmp_path / "a.json", smooth_hz=smooth)
        told = json.loads((tmp_path / "a.json").read_text())
        assert set(told) - {"smoothed_hz"} == {each.name for each in fields(Track)}
        assert set(told["pose"][0]) == {None}
        assert None not in told["pose"][2]


def test_a_folder_of_runs_names_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Several recordings have a run each in a folder; for that folder, the line names one of them."""
    body = hinges()
    write_run(tmp_path / "runs" / "walk", body, swing(body, 9))
    command = ["export", str(tmp_path / "runs"), "--to", "csv", "--out", str(tmp_path / "x.csv")]
    assert main(command) == 2
    assert f"give a run in it, such as {tmp_path / 'runs' / 'walk'}" in capsys.readouterr().err
