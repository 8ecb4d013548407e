"""Depth sequences in: one file a format, one protocol for all, found by looking at the path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from common.errors import InputError
from coordinator.sources.arrays import ArraySource, read_array, read_array_source
from coordinator.sources.camera import AS_RECORDED, CameraOptions
from coordinator.sources.picture_folders import TUM_LIST, RecordedFolder, TumFolder, holds_pictures
from coordinator.sources.point_clouds import SUFFIXES, PointClouds
from coordinator.sources.ros_bag import RosBag, is_bag
from coordinator.sources.source import Source, with_options
from coordinator.sources.utd_mhad import UtdMhadFile

__all__ = ["ArraySource", "Format", "Source", "find_format", "open_source"]


MOST_LOOKED_AT = 200  # entries of a folder, for a hint


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of recording: its name, how to know it, and how to open it."""

    name: str
    fits: Callable[[Path], bool]
    open: Callable[[Path, CameraOptions], Source]


def open_azure_kinect(path: Path, options: CameraOptions) -> Source:
    """An `.mkv`, by PyAV, which takes a while to load."""
    from coordinator.sources.azure_kinect import AzureKinectFile

    return AzureKinectFile(path, options)


def own(open_path: Callable[[Path], Source]) -> Callable[[Path, CameraOptions], Source]:
    """A format that knows its camera, which the user's options then override."""
    return lambda path, options: with_options(open_path(path), options)


def has_suffix(suffix: str) -> Callable[[Path], bool]:
    """Whether a path is a file with this suffix."""
    return lambda path: path.is_file() and path.suffix.lower() == suffix


FORMATS = (
    Format("TUM RGB-D folder (depth.txt)", lambda path: (path / TUM_LIST).is_file(), own(TumFolder)),
    Format("ROS bag, RealSense .bag", is_bag, RosBag),
    Format("Open3D folder (depth/000000.png)", holds_pictures, RecordedFolder),
    Format(
        "point clouds (.ply or .pcd)",
        lambda path: path.is_dir() and any(f.suffix.lower() in SUFFIXES for f in path.iterdir()),
        own(PointClouds),
    ),
    Format("Azure Kinect or Orbbec .mkv", has_suffix(".mkv"), open_azure_kinect),
    Format("numpy .npz (depth, intrinsics)", has_suffix(".npz"), read_array_source),
    Format("numpy .npy", has_suffix(".npy"), read_array),
    Format("UTD-MHAD .mat", has_suffix(".mat"), own(UtdMhadFile)),
)
"""In the order in which they are tried."""


DEPTH_PNG = (
    "write its depth as 16-bit PNG of millimetres in depth/000000.png, ..., and add --intrinsics fx,fy,cx,cy"
)
ROS_FOLDER = "give the folder that ROS 2 recorded, with its metadata.yaml; ros2 bag reindex writes that anew"
CONVERSIONS = {
    **dict.fromkeys((".mp4", ".avi"), f"a film holds colours, not depth; {DEPTH_PNG}"),
    **dict.fromkeys((".svo", ".svo2"), f"ZED's files need its SDK: {DEPTH_PNG}"),
    **dict.fromkeys((".db3", ".mcap"), ROS_FOLDER),
    ".oni": f"OpenNI's files need its driver: {DEPTH_PNG}",
    ".xef": f"Kinect Studio's files need its tools: {DEPTH_PNG}",
    ".exr": f"floats in EXR: {DEPTH_PNG}",
    ".h5": "save depth by numpy.save as (frames, rows, columns), metres, and add --intrinsics fx,fy,cx,cy",
    ".tiff": f"TIFF is not read: {DEPTH_PNG}",
    ".png": "give the folder that the pictures are in",
}
"""Suffix of what is not read -> how to make of it what is."""


def open_source(path: Path | str, options: CameraOptions = AS_RECORDED) -> Source:
    """The sequence at `path`, whatever its format; with the camera and units of `options`, if any.

    Reads what is needed to know the camera and the frames' numbers. Raises InputError where there is no
    sequence, or where its description is damaged.
    """
    path = Path(path)
    return find_format(path).open(path, options)


def find_format(path: Path) -> Format:
    """The format of what is at `path`; InputError names all that are read."""
    known = ", ".join(form.name for form in FORMATS)
    try:
        path.stat()
        found = next((form for form in FORMATS if form.fits(path)), None)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"no such file or folder: {path}; give the path of a recording") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give another path") from error
    if found is None and path.suffix.lower() in CONVERSIONS:
        raise InputError(f"{path} is not read; {CONVERSIONS[path.suffix.lower()]}")
    if found is None:
        what = "holds no depth sequence" if path.is_dir() else "is no depth sequence"
        raise InputError(f"{path} {what} that is known here; give {within(path)}one of: {known}")
    return found


def within(folder: Path) -> str:
    """The first recording in a folder that is none itself, as a hint; empty where there is none.

    A `.npz` may be a truth or a track, and is not proposed.
    """
    inside = sorted(islice(folder.iterdir(), MOST_LOOKED_AT)) if folder.is_dir() else []
    for path in inside:
        try:
            if path.suffix.lower() != ".npz" and any(form.fits(path) for form in FORMATS):
                return f"{path}, or "
        except OSError:  # it cannot be looked at
            continue
    return ""
