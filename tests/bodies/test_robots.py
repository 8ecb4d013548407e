"""A robot made of meshes, from its URDF file through the command line to a score against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import gepf
from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from tests.support.people import changed
from tests.support.stand_ins import Direct

FRAMES = "4"
SMALL = """
<robot name="lamp">
  <link name="foot"><visual><geometry><box size="0.12 0.08 0.03"/></geometry></visual></link>
  <link name="arm"><visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.02" length="0.2"/></geometry>
  </visual></link>
  <link name="shade"><visual><origin xyz="0.05 0 0"/><geometry><sphere radius="0.06"/></geometry></visual>
  </link>
  <joint name="lean" type="revolute"><parent link="foot"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="nod" type="revolute"><parent link="arm"/><child link="shade"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
GIMBAL = """
<robot name="gimbal">
  <link name="stand"><visual><geometry><mesh filename="stand.stl"/></geometry></visual></link>
  <link name="arm"><visual><origin xyz="0.15 0 0"/>
    <geometry><mesh filename="meshes/arm.obj" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="flag"><visual><origin xyz="0 0.1 0"/><geometry><mesh filename="meshes/flag.stl"/></geometry>
  </visual></link>
  <joint name="lift" type="revolute"><parent link="stand"/><child link="arm"/>
    <origin xyz="0 0 0.25"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="wave" type="revolute"><parent link="arm"/><child link="flag"/>
    <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A stand, an arm in millimetres and a flag, as .stl and .obj beside the file and below it."""
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.2, 0.16, 0.5)).export(tmp_path / "stand.stl")
    trimesh.creation.box((300.0, 60.0, 40.0)).export(tmp_path / "meshes" / "arm.obj")
    trimesh.creation.box((0.04, 0.26, 0.08)).export(tmp_path / "meshes" / "flag.stl")
    path = tmp_path / "gimbal.urdf"
    path.write_text(GIMBAL)
    return path


def test_a_robot_of_meshes_is_tracked(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rendered with noise while it moves, tracked with a fixed base: its joints are right."""
    seq, run = robot.parent / "seq", robot.parent / "run"
    model = ("--model", str(robot))
    assert main(["synth", "roam", *model, "--kinect", "--frames", FRAMES, "--out", str(seq), "-q"]) == 0
    tracking = ["track", str(seq), *model, "--dof", "joints", "--out", str(run), "-q"]
    assert main(tracking, Direct().connect) == 0
    assert main(["evaluate", str(run), "--truth", str(seq / "truth.npz")]) == 0
    score = json.loads(capsys.readouterr().out)
    assert set(score["mean_angle_error_deg_by_dof"]) == {"lift", "wave"}
    assert score["mean_angle_error_deg"] < 3.0
    track = read_track(run)
    assert track.dof_names == ("lift", "wave")
    assert set(track.status) == {"tracked"}
    base = [track.joint_names.index(name) for name in ("stand", "lift")]
    assert (track.joint_off_probability[:, base] == 0.0).all()
    assert np.ptp(track.joint_positions[:, track.joint_names.index("lift")], axis=0).max() < 1e-12


def lamp_in_a_room(folder: Path) -> tuple[Path, Path]:
    """The URDF file of a lamp, and a recording of it in a room."""
    path, seq = folder / "lamp.urdf", folder / "seq"
    path.write_text(SMALL)
    shown = ("roam", "--model", str(path), "--room", "--kinect", "--frames", FRAMES)
    assert main(["synth", *shown, "--out", str(seq), "-q"]) == 0
    return path, seq


@pytest.mark.parametrize("wall_m", [None, 1.3])
def test_a_robot_much_smaller_than_a_person_is_detected_in_a_room(
    tmp_path: Path, wall_m: float | None
) -> None:
    """A lamp on the floor, or close to a wall: a candidate is as large as the body, not as a person."""
    path, seq = lamp_in_a_room(tmp_path)
    source, truth = gepf.open_source(seq), np.load(seq / "truth.npz")
    with gepf.Tracker(model=path) as tracker:
        for number, joints in enumerate(truth["joint_positions"]):
            frame = source.frame(number)
            if wall_m is not None:
                depth, units = frame.views[0].depth, wall_m * frame.views[0].depth_scale
                near = np.where((depth == 0) | (depth > units), units, depth).astype(depth.dtype)
                frame = changed(frame, depth=near)
            estimate = tracker.track(frame)
            assert estimate.status in {"tracked", "ambiguous"}
            assert np.linalg.norm(estimate.joint_positions - joints, axis=1).max() < 0.05
