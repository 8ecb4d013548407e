"""A folder of point clouds, one file per frame: PLY or PCD, metres, in the camera frame (z forward).

Each cloud is projected to a depth image with the nearest point of each pixel. The camera is that of the user,
of camera_intrinsic.json, or of the organised cloud (PCD with rows and columns). Otherwise it is a nominal
camera of 640 x 480.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, project
from gepf.common.errors import InputError
from gepf.coordinator.files import CAMERA_FILE
from gepf.coordinator.sources.camera import DEFAULT_FPS, NOMINAL, GivenCamera, read_camera
from gepf.coordinator.sources.source import Source

SUFFIXES = (".ply", ".pcd")
LARGEST_MISFIT_PX = 0.05  # error of the pixels of a pinhole camera


def read_clouds(path: Path, given: GivenCamera) -> Source:
    """Read the clouds of a folder in the order of the numbers in their names, numbered from 0."""
    files = cloud_files(path)
    first, camera, fps = read_cloud(files[0]), NOMINAL, DEFAULT_FPS
    organised = first.ndim == 3
    if (path / CAMERA_FILE).exists():
        camera, _, fps = read_camera(path / CAMERA_FILE)
    elif organised and given.intrinsics is None:
        camera = own_camera(first, files[0])
    if given.intrinsics is not None:
        camera = given.camera(first.shape if organised else (camera.height, camera.width), path)

    def read(place: int) -> Array:
        return render_points(read_cloud(files[place]).reshape(-1, 3), camera)

    scale = given.depth_scale or 1.0
    return Source(path.resolve().name, camera, range(len(files)), read, scale, fps, folder=path)


def cloud_files(path: Path) -> list[Path]:
    """The clouds of a folder, in the order of the numbers in their names."""
    files = [f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith(".")]
    kinds = {f.suffix.lower() for f in files}
    if len(kinds) > 1:
        raise InputError(f"{path} holds both .ply and .pcd files; keep those of one kind")
    return sorted(files, key=lambda f: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", f.stem)])


def read_cloud(path: Path) -> Array:
    """Points (N, 3), or (H, W, 3) for an organised cloud; InputError if it is damaged."""
    try:
        if path.suffix.lower() != ".ply":
            return read_pcd(path)
        import trimesh

        loaded: Any = trimesh.load(path, process=False)  # a mesh or a cloud
        return np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # the readers can raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path} is damaged or not a point cloud ({reason}); copy it again") from error


def read_pcd(path: Path) -> Array:
    """Points of a PCD file, (N, 3) or organised (H, W, 3)."""
    from pypcd4.pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    points = np.asarray(cloud.numpy(("x", "y", "z")), dtype=np.float64)
    rows, columns = cloud.metadata.height, cloud.metadata.width
    return points.reshape(rows, columns, 3) if rows > 1 else points


def own_camera(points: Array, path: Path) -> Intrinsics:
    """The camera of an organised cloud (H, W, 3); InputError if it is not a pinhole camera."""
    rows, columns = points.shape[:2]
    v, u = np.indices((rows, columns))
    seen = np.isfinite(points).all(axis=2) & (points[:, :, 2] > 0)
    fx, cx, off_x = fit_axis(points[seen][:, 0] / points[seen][:, 2], u[seen])
    fy, cy, off_y = fit_axis(points[seen][:, 1] / points[seen][:, 2], v[seen])
    if not (fx > 0 and fy > 0 and max(off_x, off_y) < LARGEST_MISFIT_PX):
        raise InputError(f"{path} is organised, but not by a pinhole camera; add {CAMERA_FILE} to the folder")
    return Intrinsics(columns, rows, fx, fy, cx, cy)


def fit_axis(slopes: Array, pixels: NDArray[np.integer]) -> tuple[float, float, float]:
    """Focal length and centre with pixel = centre + focal x slope, and the largest error in pixels."""
    if len(slopes) < 2 or np.ptp(slopes) == 0.0:
        return 0.0, 0.0, np.inf
    focal, centre = np.polyfit(slopes, pixels, 1)
    return float(focal), float(centre), float(np.abs(centre + focal * slopes - pixels).max())


def render_points(points: Array, camera: Intrinsics) -> Array:
    """Depth (H, W) in metres of points (N, 3): the nearest of each pixel, 0 if there is none."""
    depth = np.full((camera.height, camera.width), np.inf)
    points = points[np.isfinite(points).all(axis=1)]
    points = points[points[:, 2] > 0]
    column, row = np.rint(project(points, camera)).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    at = (row[inside].astype(np.int64), column[inside].astype(np.int64))
    np.minimum.at(depth, at, points[inside, 2])
    return np.where(np.isfinite(depth), depth, 0.0)
