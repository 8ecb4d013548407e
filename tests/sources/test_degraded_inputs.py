"""Recordings that differ from others only in how they are written are tracked as well, within 0.3 cm."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

import gepf
from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, back_project
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.cli import main
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.point_clouds import render_points
from tests.support import bags
from tests.support.people import CAMERA, STANDING, raised, rendered
from tests.support.recordings import Depth, write_open3d
from tests.support.rooms import along
from tests.support.ros import camera_of, header_of, image_of
from tests.support.stand_ins import Direct

FRAMES = 8
OPTIONS = ("--particles", "6", "--points", "1500", "--no-pictures")
RAISING = {"l_elbow_flexion": 0.12, "l_shoulder_flexion": 0.08, "root_tx": 0.01}
FLOOR, WALL = 1.15, 4.0  # metres below and before the camera
ALLOWED_M = 0.004
ALLOWED_OF_CLOUDS_M = 0.006  # their images have another size, and other pixels that look like a person
COLOUR = Intrinsics(1280, 720, 920.0, 920.0, 639.5, 359.5)
APART_M = 0.025  # from the depth camera to that of colour
DISTORTION = (0.12, -0.2, 0.001, -0.002, 0.05)


@cache
def poses() -> Array:
    """Poses (F, D) of a person who raises the left arm and walks."""
    model = human(1.82)
    return np.array([name_pose(model, raised(STANDING, n, RAISING)) for n in range(FRAMES)])


def room(camera: Intrinsics) -> Array:
    """Depth (H, W) of a floor and a wall, metres."""
    rays = back_project(np.ones((camera.height, camera.width)), camera)
    with np.errstate(divide="ignore"):
        return np.minimum(along(FLOOR, rays[..., 1]), along(WALL, rays[..., 2]))


@cache
def filmed(camera: Intrinsics) -> Array:
    """Depth (F, H, W) of the person in a room, metres."""
    pictures = np.array(rendered(human(1.82), poses(), camera))
    return np.where(pictures > 0, pictures, room(camera))


def millimetres(depth: Array) -> Depth:
    """Whole millimetres."""
    return np.rint(1000.0 * depth).astype(np.uint16)


def error(sequence: Path, apart_m: float = 0.0) -> float:
    """Mean distance of the tracked joints from the true ones, metres; every frame must be tracked."""
    out = sequence.with_name(f"run_{sequence.name}")
    assert main(["track", str(sequence), "--out", str(out), *OPTIONS], Direct().connect) == 0
    track = gepf.load(out).track
    assert set(track.status) <= {"tracked", "ambiguous"}
    truth = joint_positions(human(1.82), poses()) - [apart_m, 0.0, 0.0]
    return float(np.linalg.norm(track.joint_positions - truth, axis=-1).mean())


def test_depth_registered_to_a_larger_colour_image_is_tracked(tmp_path: Path) -> None:
    """With holes between the points, of which a line tells, as well as before it was registered."""
    own = Intrinsics(640, 480, 480.0, 480.0, 319.5, 239.5)
    clouds = [back_project(depth, own).reshape(-1, 3) for depth in filmed(own)]
    sparse = np.array([render_points(cloud - [APART_M, 0.0, 0.0], COLOUR) for cloud in clouds])
    assert np.mean(sparse > 0) < 0.5
    path = write_open3d(tmp_path / "sparse", millimetres(sparse), COLOUR)
    assert open_source(path).is_sparse
    dense = write_open3d(tmp_path / "dense", millimetres(filmed(own)), own)
    assert not open_source(dense).is_sparse
    assert error(path, APART_M) == pytest.approx(error(dense), abs=ALLOWED_M)


def test_point_clouds_without_a_camera_are_tracked(tmp_path: Path) -> None:
    """PLY files as well as the depth images that they were made of."""
    path = tmp_path / "clouds"
    path.mkdir()
    for n, depth in enumerate(filmed(CAMERA)):
        cloud = trimesh.PointCloud(back_project(depth, CAMERA).reshape(-1, 3))  # type: ignore[no-untyped-call]
        (path / f"{n}.ply").write_bytes(cloud.export(file_type="ply"))  # type: ignore[no-untyped-call]
    plain = write_open3d(tmp_path / "plain", millimetres(filmed(CAMERA)), CAMERA)
    assert error(path) == pytest.approx(error(plain), abs=ALLOWED_OF_CLOUDS_M)


def test_images_of_a_lens_are_tracked(tmp_path: Path) -> None:
    """A bag with distortion in its camera_info as well as one of a camera without."""
    fine = Intrinsics(960, 720, 3 * CAMERA.fx, 3 * CAMERA.fy, 3 * CAMERA.cx + 1.0, 3 * CAMERA.cy + 1.0)
    columns, rows = np.rint(seen_at(CAMERA, fine)).astype(int)
    inside = (columns >= 0) & (columns < fine.width) & (rows >= 0) & (rows < fine.height)
    at = np.where(inside, rows, 0), np.where(inside, columns, 0)
    images = {
        "lens": [np.where(inside, depth[at], 0.0) for depth in filmed(fine)],
        "plain": [*filmed(CAMERA)],
    }
    off = {}
    for name, pictures in images.items():
        path = tmp_path / name
        make = bags.types_of(path).types
        lens = DISTORTION if name == "lens" else (0.0,) * 5
        info = camera_of(make, header_of(make, "depth"), CAMERA, lens)
        messages = [bags.Message(bags.INFO, bags.EPOCH_NS, info)]
        for n, depth in enumerate(pictures):
            stamp = bags.EPOCH_NS + n * 33_000_000
            header = header_of(make, "depth", *divmod(stamp, bags.SECOND_NS))
            messages.append(bags.Message(bags.TOPIC, stamp, image_of(make, header, millimetres(depth))))
        off[name] = error(bags.write(path, messages))
    assert off["lens"] == pytest.approx(off["plain"], abs=ALLOWED_M)


def seen_at(camera: Intrinsics, fine: Intrinsics) -> tuple[Array, Array]:
    """Columns and rows (H, W) of a finer pinhole image that the distorted pixels of a camera see."""
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    across, down = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    k1, k2, p1, p2, k3 = DISTORTION
    x, y = across.copy(), down.copy()
    for _ in range(30):  # the fixed point of OpenCV's undistortPoints
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x = (across - 2.0 * p1 * x * y - p2 * (r2 + 2.0 * x * x)) / radial
        y = (down - p1 * (r2 + 2.0 * y * y) - 2.0 * p2 * x * y) / radial
    return fine.cx + fine.fx * x, fine.cy + fine.fy * y
