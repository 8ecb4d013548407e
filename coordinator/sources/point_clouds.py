"""A folder of point clouds, one file per frame: PLY or PCD, metres, in the camera frame (z forward).

Each cloud is projected to a depth image with the nearest point of each pixel. The camera is that of the user,
of camera_intrinsic.json, or of the organised cloud (PCD with rows and columns). Otherwise its pixels are as
wide as the spacing of the points, and its field of view is that of a nominal camera, or larger, so that all
points are in it. Gaps that remain are closed, as of all sparse depth.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, project
from gepf.common.errors import InputError
from gepf.coordinator.files import CAMERA_FILE
from gepf.coordinator.sources.camera import (
    DEFAULT_FPS,
    MILLIMETRES,
    NOMINAL,
    GivenCamera,
    find_camera_file,
    read_camera,
)
from gepf.coordinator.sources.picture_folders import find_frames
from gepf.coordinator.sources.source import FARTHEST_M, Source, rate_of

logger = logging.getLogger(__name__)

SUFFIXES = (".ply", ".pcd")


class CloudCamera(msgspec.Struct, frozen=True):
    """The camera that is assumed for points."""

    max_misfit_px: float = 0.05  #: error of the pixels of an organised cloud
    max_slope: float = 2.0  #: of the line of sight at the border of the image: 127 degrees in all
    max_focal: float = 2.0  #: focal length, as a multiple of the nominal camera's


ASSUMED = CloudCamera()


def read_clouds(path: Path, given: GivenCamera) -> Source:
    """Read the clouds of a folder in the order of the numbers in their names, numbered from 0."""
    files, times = cloud_files(path)
    first, fps = read_cloud(files[0]), DEFAULT_FPS if times is None else rate_of(times)
    organised = first.ndim == 3
    camera = NOMINAL
    if find_camera_file(path) is not None:
        camera, _, recorded = read_camera(path, given)
        fps = fps if times is not None else recorded
    elif organised and given.intrinsics is None:
        camera = own_camera(first, files[0])
    elif given.intrinsics is None:
        others = {files[len(files) // 2], files[-1]} - {files[0]}
        camera = fitting_camera([first, *map(read_cloud, sorted(others))])
    if given.intrinsics is not None and (organised or camera is NOMINAL):
        middle_of = round(2.0 * given.intrinsics[3] + 1.0), round(2.0 * given.intrinsics[2] + 1.0)
        camera = given.camera(first.shape if organised else middle_of, path)
    scale = given.depth_scale or 1.0
    depth = first[np.isfinite(first).all(axis=-1)][:, 2]
    if given.depth_scale is None and depth.size and (middle := float(np.median(depth))) > FARTHEST_M:
        logger.warning("%s: points (median depth %.0f) are interpreted as millimetres", path, middle)
        scale = MILLIMETRES

    def read(place: int) -> Array:
        return render_points(read_cloud(files[place]).reshape(-1, 3), camera)

    name, numbers = path.resolve().name, range(len(files))
    return Source(name, camera, numbers, read, scale, fps, times, folder=path, of_points=True)


def cloud_files(path: Path) -> tuple[list[Path], list[float] | None]:
    """The clouds of a folder, in the order of the numbers in their names, and their times if known."""
    kinds = {f.suffix.lower() for f in path.iterdir() if not f.name.startswith(".")} & set(SUFFIXES)
    if len(kinds) > 1:
        raise InputError(f"{path} holds both .ply and .pcd files; keep those of one kind")
    _, files, times = find_frames(path, path, kinds)
    return files, times


def fitting_camera(clouds: Sequence[Array]) -> Intrinsics:
    """A camera for unorganised clouds (N, 3) that sees all points, about one in each pixel."""
    slopes, spacings = [np.zeros((1, 2))], []
    nth = 4  # distance to this neighbour: the spacing of a square grid, and nearly that of random points
    for cloud in clouds:
        points = cloud[np.isfinite(cloud).all(axis=1) & (cloud[:, 2] > 0)]
        seen = np.unique(points[:, :2] / points[:, 2:], axis=0)
        slopes.append(seen[(np.abs(seen) <= ASSUMED.max_slope).all(axis=1)])
        if len(seen) > nth:
            from scipy.spatial import cKDTree  # takes long to load

            spacings.append(float(np.median(cKDTree(seen).query(seen, nth + 1)[0][:, -1])))
    focal = min(1.0 / float(np.median(spacings)), ASSUMED.max_focal * NOMINAL.fx) if spacings else NOMINAL.fx
    every = np.concatenate(slopes)
    usual = np.array([NOMINAL.width, NOMINAL.height]) / (2.0 * NOMINAL.fx)
    first = np.floor(focal * np.minimum(every.min(axis=0), -usual))
    width, height = (np.ceil(focal * np.maximum(every.max(axis=0), usual)) - first + 1.0).astype(int).tolist()
    return Intrinsics(width, height, focal, focal, *(-first).tolist())


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
    if not (fx > 0 and fy > 0 and max(off_x, off_y) < ASSUMED.max_misfit_px):
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
