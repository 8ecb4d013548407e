"""One sequence of depth, written as every format that is read."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from pypcd4.pypcd4 import Encoding, PointCloud
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, back_project
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.files import CAMERA_FILE
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.camera import write_camera
from gepf.coordinator.sources.utd_mhad import KINECT
from tests.support.people import raised, rendered
from tests.support.ros import camera_of, header_of, image_of

Depth = NDArray[np.uint16]  # (F, H, W), millimetres
Write = Callable[[Path, Depth], Path]

FPS = 30.0
SENSOR = "/device_0/sensor_0"


def matrix_of(camera: Intrinsics) -> Array:
    """The camera's matrix (3, 3)."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])


def write_open3d(path: Path, depth: Depth, camera: Intrinsics = KINECT, fps: float = FPS) -> Path:
    """As Open3D's recorders do."""
    (path / "depth").mkdir(parents=True)
    for n, image in enumerate(depth):
        Image.fromarray(image).save(path / "depth" / f"{n:06d}.png")
    write_camera(path / CAMERA_FILE, camera, 1000.0, fps)
    return path


def write_tum(path: Path, depth: Depth, with_camera: bool = True) -> Path:
    """As the TUM benchmark's folders: names are times, values 5000 a metre."""
    (path / "depth").mkdir(parents=True)
    lines = ["# depth maps", "# file: 'x.bag'", "# timestamp filename"]
    for n, image in enumerate(depth):
        name = f"depth/{1305031102.160407 + n / FPS:.6f}.png"
        Image.fromarray((image * 5).astype(np.uint16)).save(path / name)
        lines.append(f"{1305031102.160407 + n / FPS:.6f} {name}")
    (path / "depth.txt").write_text("\n".join(lines) + "\n")
    if with_camera:
        write_camera(path / CAMERA_FILE, KINECT, 5000.0)
    return path


def clouds_of(depth: Depth) -> NDArray[np.float32]:
    """Points (F, H, W, 3) in metres; NaN where nothing was measured."""
    points = np.array([back_project(image / 1000.0, KINECT) for image in depth])
    return np.where(depth[..., None] > 0, points, np.nan).astype(np.float32)


def write_ply(path: Path, depth: Depth, per_metre: float = 1.0) -> Path:
    """Unorganised clouds as PLY, the camera beside them."""
    path.mkdir(parents=True)
    for n, cloud in enumerate(clouds_of(depth)):
        seen = cloud[np.isfinite(cloud).all(axis=2)] * per_metre
        points: Any = trimesh.PointCloud(seen)  # type: ignore[no-untyped-call]
        (path / f"cloud_{n}.ply").write_bytes(points.export(file_type="ply"))
    write_camera(path / CAMERA_FILE, KINECT, 1000.0)
    return path


def write_pcd(path: Path, depth: Depth, encoding: Encoding = Encoding.BINARY_COMPRESSED) -> Path:
    """Organised clouds as PCD, which hold their camera themselves."""
    path.mkdir(parents=True)
    for n, points in enumerate(clouds_of(depth)):
        cloud = PointCloud.from_points(points.reshape(-1, 3), ("x", "y", "z"), (np.float32,) * 3)
        cloud.metadata.height, cloud.metadata.width = points.shape[:2]
        cloud.save(path / f"{n}.pcd", encoding)
    return path


def write_bag(path: Path, depth: Depth, units: float | None = 0.001, camera: Intrinsics = KINECT) -> Path:
    """As librealsense records: image, camera_info and the option that holds the units."""
    types: Any = get_typestore(Stores.ROS1_NOETIC)
    make = types.types
    header, info = header_of(make), f"{SENSOR}/Depth_0/info/camera_info"
    messages = [(info, 1, camera_of(make, header, camera))]
    if units is not None:
        messages.append((f"{SENSOR}/option/Depth_Units/value", 1, make["std_msgs/msg/Float32"](units)))
    for n, values in enumerate(depth):
        content = image_of(make, header, values.astype("<u2"), "mono16")
        messages.append((f"{SENSOR}/Depth_0/image/data", round((5.0 + n / FPS) * 1e9), content))
    path.parent.mkdir(parents=True, exist_ok=True)
    with Writer(path) as bag:
        for topic, time, message in messages:
            known = next((c for c in bag.connections if c.topic == topic), None)
            connection = known or bag.add_connection(topic, message.__msgtype__, typestore=types)
            bag.write(connection, time, types.serialize_ros1(message, message.__msgtype__))
    return path


def write_npz(path: Path, depth: Depth) -> Path:
    """Whole millimetres."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, depth=depth, intrinsics=matrix_of(KINECT), depth_scale=1000, fps=FPS)
    return path


def write_npz_metres(path: Path, depth: Depth) -> Path:
    """Metres as float32, NaN where nothing was measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metres = np.where(depth > 0, depth / 1000.0, np.nan).astype(np.float32)
    np.savez(path, depth=metres, intrinsics=matrix_of(KINECT))
    return path


def write_mat(path: Path, depth: Depth) -> Path:
    """As the UTD-MHAD data set."""
    path.parent.mkdir(parents=True, exist_ok=True)
    savemat(path, {"d_depth": np.moveaxis(depth, 0, 2)}, do_compression=True)
    return path


WRITERS: dict[str, Write] = {
    "open3d": write_open3d,
    "tum": write_tum,
    "ply": write_ply,
    "pcd": write_pcd,
    "walk.bag": write_bag,
    "walk.npz": write_npz,
    "metres.npz": write_npz_metres,
    "walk.mat": write_mat,
}
"""Name of the file or folder -> how it is written."""


START = {"root_ty": 0.1, "root_tz": 2.6, "r_shoulder_abduct": 0.3, "l_shoulder_abduct": 0.3}
RAISING = {"r_elbow_flexion": 0.12, "root_tx": 0.01}  # by frame
FRAMES = 3


@cache
def recorded() -> Depth:
    """Frames (F, H, W) of a person who raises a forearm, in whole millimetres."""
    model = human(1.75)
    poses = np.array([name_pose(model, raised(START, n, RAISING)) for n in range(FRAMES)])
    millimetres: Array = np.rint(np.array(rendered(model, poses, KINECT)) * 1000.0)
    return millimetres.astype(np.uint16)


def read_all(path: Path) -> None:
    """Open a sequence and read every frame."""
    list(open_source(path))
