"""Frames, bodies, estimates and runs as Open3D's geometry."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

import gepf
from gepf.common.camera import rigid
from gepf.common.kinematics import joint_positions, pose_vertices
from tests.support.bodies import person
from tests.support.runs import swing, write_run

CAMERA = gepf.Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
WALL_M = 2.0
TURNED = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def wall(**changes: object) -> gepf.View:
    """A wall that fills the image, but for a row without depth."""
    depth = np.full((48, 64), 1000 * WALL_M, np.uint16)
    depth[0] = 0
    values = {"number": 0, "time_s": 0.0, "depth": depth, "depth_scale": 1000.0, "intrinsics": CAMERA}
    return gepf.View(**values | changes)  # type: ignore[arg-type]


def test_a_frame_is_a_point_cloud_as_open3d_makes_it() -> None:
    """The points that Open3D itself makes of the image, with normals towards the camera."""
    view = wall()
    cloud = gepf.to_open3d(gepf.Frame.of(view))
    lens = o3d.camera.PinholeCameraIntrinsic(64, 48, 60.0, 60.0, 31.5, 23.5)
    image = o3d.geometry.Image(view.depth)  # type: ignore[call-overload]
    expected = o3d.geometry.PointCloud.create_from_depth_image(image, lens)
    assert np.allclose(np.asarray(cloud.points), np.asarray(expected.points), atol=1e-6)
    assert np.allclose(np.asarray(cloud.normals), (0.0, 0.0, -1.0), atol=1e-6)


def test_the_cameras_of_a_rig_share_one_cloud() -> None:
    """Each with its pose: the wall of a camera that looks along x is where x is the distance."""
    side = wall(camera="side", T_rig_camera=rigid(TURNED, np.array([0.5, 0.0, 0.0])))
    cloud = gepf.to_open3d(gepf.Frame.of(wall(), side))
    points, count = np.asarray(cloud.points), 47 * 64
    assert len(points) == 2 * count
    assert np.allclose(points[:count, 2], WALL_M)
    assert np.allclose(points[count:, 0], WALL_M + 0.5)
    assert np.allclose(np.asarray(cloud.normals)[count:], (-1.0, 0.0, 0.0), atol=1e-6)


def test_a_body_is_a_mesh_and_a_skeleton() -> None:
    """In its pose; a pose of another length is refused."""
    model = person()
    pose = swing(model, 1)[0]
    mesh = gepf.to_open3d(model, pose)
    assert np.allclose(np.asarray(mesh.vertices), pose_vertices(model, pose[None])[0])
    assert np.array_equal(np.asarray(mesh.triangles), model.triangles)
    lines = gepf.to_open3d(model, pose, skeleton=True)
    assert np.allclose(np.asarray(lines.points), joint_positions(model, pose[None])[0])
    names = [[model.joint_names[j] for j in pair] for pair in np.asarray(lines.lines)]
    assert ["right_elbow", "right_wrist"] in [sorted(pair) for pair in names]
    for wrong in (None, pose[:-1], np.full_like(pose, np.nan)):
        with pytest.raises(gepf.InputError, match=f"give {len(pose)} finite numbers"):
            gepf.to_open3d(model, wrong)


def test_a_run_is_a_mesh_or_skeleton_per_frame(tmp_path: Path) -> None:
    """In the order of the frames; those before the body was found are empty."""
    model = person()
    poses = swing(model, 3)
    poses[0] = np.nan
    write_run(tmp_path / "run", model, poses, lost=(0,))
    run = gepf.load(tmp_path / "run")
    for skeleton, whole in ((False, pose_vertices), (True, joint_positions)):
        first, *others = gepf.to_open3d(run, skeleton=skeleton)
        assert first.is_empty()
        for each, expected in zip(others, whole(model, poses[1:]), strict=True):
            points = each.points if skeleton else each.vertices
            assert np.allclose(np.asarray(points), expected)


def test_without_open3d_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is computed."""
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(ImportError, match=r"to_open3d needs the package open3d, .*'gepf\[open3d\]'"):
        gepf.to_open3d(gepf.Frame.of(wall()))
