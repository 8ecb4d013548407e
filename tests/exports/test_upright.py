"""A pitched or rotated camera does not tilt the exports: compared with a level camera."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.common.kinematics.rotations import euler_angles, euler_matrix
from gepf.coordinator.exports import export_run
from gepf.coordinator.exports.axes import CAMERA_TO_Y_UP
from gepf.coordinator.exports.recorded import read_run
from gepf.coordinator.results.log import floor_up
from gepf.coordinator.scene.scene import Scene, SceneChanges
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.pose_library import upright_rolls
from gepf.coordinator.tracking.segmenter import ExpectedSurface, Segmenter
from gepf.coordinator.viewing import layout
from tests.support.bodies import person, puppet, random_body
from tests.support.export_readers import bvh_joints, c3d_points, read_gltf, world_matrices
from tests.support.rooms import HEIGHT, Room
from tests.support.runs import swing, write_run

PITCH = np.radians(30.0)
CAMERAS = {
    "pitched": Rotation.from_euler("x", PITCH).as_matrix(),
    "pitched and rolled": Rotation.from_euler("xz", [PITCH, 0.4]).as_matrix(),
    "upside down": Rotation.from_euler("z", np.pi).as_matrix(),
}
"""From the axes of a level camera, seen straight ahead, to those of the camera (3, 3)."""


def through(turn: Array, poses: Array) -> Array:
    """Poses (F, D) as a camera has them that is turned against one in which they are given."""
    seen = poses.copy()
    for pose in seen:
        pose[:3] = turn @ pose[:3]
        pose[3:6] = euler_angles(turn @ euler_matrix(pose[3:6]), pose[3:6])
    return seen


@pytest.fixture(params=CAMERAS)
def runs(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path, BodyModel]:
    """The folders of a run with a level camera, and of the same run with another."""
    model, turn = person(), CAMERAS[request.param]
    poses = swing(model, 4)
    write_run(tmp_path / "level", model, poses)
    up = turn @ np.array([0.0, -1.0, 0.0])
    write_run(tmp_path / "turned", model, through(turn, poses), up=up)
    return tmp_path / "level", tmp_path / "turned", model


def heading(level: Array, turned: Array) -> Array:
    """The turn about the vertical (3, 3) that takes places (..., 3) of one onto those of the other, y up."""
    a, b = level.reshape(-1, 3)[:, ::2], turned.reshape(-1, 3)[:, ::2]
    angle = np.angle(np.sum((b[:, 0] + 1j * b[:, 1]) * np.conj(a[:, 0] + 1j * a[:, 1])))
    found: Array = Rotation.from_euler("y", -angle).as_matrix()
    return found


def test_bvh_glb_trc_and_c3d_stand_upright(runs: tuple[Path, Path, BodyModel]) -> None:
    """Independent readers find every joint as with the level camera, except for the heading."""
    *folders, model = runs
    found: dict[str, list[Array]] = {"bvh": [], "c3d": [], "trc": [], "glb": []}
    for folder in folders:
        for form in found:
            export_run(folder, form, folder.with_suffix(f".{form}"))
        found["bvh"].append(bvh_joints(folder.with_suffix(".bvh"), model.joint_names, 4) / 100.0)
        found["c3d"].append(c3d_points(folder.with_suffix(".c3d"))[1][:, : len(model.joint_names), :3] / 1e3)
        rows = folder.with_suffix(".trc").read_text().splitlines()[6:]
        trc = np.array([[float(cell) for cell in row.split("\t")[2:]] for row in rows]) / 1e3
        found["trc"].append(trc.reshape(4, -1, 3))
        found["glb"].append(gltf_joints(folder.with_suffix(".glb"), model))
    for level, turned in found.values():
        assert level.shape == turned.shape == (4, len(model.joint_names), 3)
        assert np.abs(level @ heading(level, turned).T - turned).max() < 2e-4


def gltf_joints(path: Path, model: BodyModel) -> Array:
    """Places (F, J, 3) of the joints, by the nodes' matrices."""
    gltf = read_gltf(path)
    frames = [world_matrices(gltf, f) for f in range(4)]
    return np.array([[nodes[name][:3, 3] for name in model.joint_names] for nodes in frames])


def test_csv_and_mot_say_how_the_pelvis_is_tilted_against_the_vertical(
    runs: tuple[Path, Path, BodyModel],
) -> None:
    """Tilts are those of the level camera; joint positions in a CSV stay in the camera frame."""
    level, turned, _ = runs
    tilts = []
    for folder in (level, turned):
        export_run(folder, "csv", folder.with_suffix(".csv"))
        with folder.with_suffix(".csv").open() as file:
            lines = list(csv.DictReader(file))
        names = ("pelvis_forward_tilt_deg", "pelvis_side_tilt_deg")
        tilts.append(np.array([[float(line[name]) for name in names] for line in lines]))
        track = read_run(folder).track
        assert float(lines[0]["head_y"]) == track.joint_positions[0, track.joint_names.index("head"), 1]
        export_run(folder, "mot", folder.with_suffix(".mot"))
    np.testing.assert_allclose(tilts[0], tilts[1], atol=1e-6)
    tables = [opensim_columns(folder.with_suffix(".mot")) for folder in (level, turned)]
    for name in ("pelvis_tilt", "pelvis_list", "pelvis_ty"):
        np.testing.assert_allclose(tables[0][name], tables[1][name], atol=1e-5)


def opensim_columns(path: Path) -> dict[str, Array]:
    """Columns of a motion file by name."""
    lines = path.read_text().split("endheader\n")[1].splitlines()
    values = np.array([[float(cell) for cell in line.split("\t")] for line in lines[1:]])
    return dict(zip(lines[0].split("\t"), values.T, strict=True))


@pytest.mark.parametrize("apart", [0.0, 0.02])
@pytest.mark.parametrize("body", ["puppet", *range(2)])
def test_a_robot_that_stands_still_is_turned_too(tmp_path: Path, body: str | int, apart: float) -> None:
    """The root of a body whose base does not move is turned once; its joints are where they were.

    Also with joints a few centimetres away from their axis or from the base.
    """
    rng = np.random.default_rng(body if isinstance(body, int) else 0)
    model = puppet() if body == "puppet" else random_body(rng)
    if apart:
        model = with_joints_beside(model, apart * rng.normal(size=(len(model.link_names), 3)))
    track = write_run(
        tmp_path / "run", model, swing(model, 4), up=CAMERAS["pitched"] @ np.array([0.0, -1.0, 0.0])
    )
    for form in ("bvh", "glb"):
        export_run(tmp_path / "run", form, tmp_path / f"run.{form}")
    expected = track.joint_positions @ read_run(tmp_path / "run").from_camera(CAMERA_TO_Y_UP).T
    read = bvh_joints(tmp_path / "run.bvh", model.joint_names, 4) / 100.0
    assert np.abs(read - expected).max() < 1e-4
    assert np.abs(gltf_joints(tmp_path / "run.glb", model) - expected).max() < 1e-4


def with_joints_beside(model: BodyModel, beside: Array) -> BodyModel:
    """A joint on each link, so far (L, 3) from the point about which it turns; metres, at rest."""
    about = np.where(model.link_dofs[:, None] < 0, 0.0, model.points[model.link_dofs])
    names = tuple(f"joint_{link}" for link in range(len(about)))
    links = np.arange(len(about), dtype=np.int64)
    return dataclasses.replace(model, joint_names=names, joint_links=links, joint_points=about + beside)


def test_the_viewer_s_eye_stands_upright() -> None:
    """Its up is against gravity."""
    up = CAMERAS["pitched"] @ np.array([0.0, -1.0, 0.0])
    for known, expected in ((up, up), (None, [0.0, -1.0, 0.0])):
        root: Any = layout(np.zeros(3), known).root_container
        eye = root.contents[0].properties["EyeControls3D"]
        np.testing.assert_allclose(eye.eye_up.as_arrow_array().to_pylist()[0], expected, atol=1e-6)


def first_changes(view: View) -> SceneChanges:
    """What the first frame changes in the known scene."""
    segmenter = Segmenter(1000, SceneSettings())
    return segmenter.learn(segmenter.segment(Frame.of(view), [ExpectedSurface()]))


def test_up_comes_from_the_floor_that_a_pitched_camera_sees() -> None:
    """Within half a degree, with a person, noise and 30 degrees of pitch."""
    room = Room(pitch=PITCH, noise=0.0015)
    up = floor_up(first_changes(room.see((0.0, 2.4)).view))
    assert up is not None
    assert up @ (room.tilt.T @ np.array([0.0, -1.0, 0.0])) > np.cos(np.radians(0.5))
    frame = room.see(None).view
    nothing = dataclasses.replace(frame, depth=np.zeros_like(frame.depth))
    assert floor_up(first_changes(nothing)) is None


def test_a_camera_on_its_side_finds_its_floor_where_gravity_is_known() -> None:
    """An image rotated by a quarter turn has its floor at one side; it is a floor only if up is known."""
    frame = Room((), 0.2, noise=0.0015).see(None).view
    camera = frame.intrinsics
    lens = Intrinsics(
        camera.height, camera.width, camera.fy, camera.fx, camera.cy, camera.width - 1 - camera.cx
    )
    side = dataclasses.replace(frame, depth=np.ascontiguousarray(np.rot90(frame.depth)), intrinsics=lens)
    assert not Scene(SceneSettings()).observe(side).planes.has_floor
    view = Scene(SceneSettings(), up=np.array([-1.0, 0.0, 0.0])).observe(side)
    assert view.planes.camera_height == pytest.approx(HEIGHT, abs=0.02)
    assert upright_rolls(view.planes, (0.0, 0.5 * np.pi), 0.3)[0] % (2 * np.pi) == pytest.approx(
        0.5 * np.pi, abs=0.02
    )
