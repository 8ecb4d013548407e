"""Depth sequences in: one file a format, one protocol for all, found by looking at the path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from common.errors import InputError
from coordinator.sources.arrays import ArraySource, read_array_source
from coordinator.sources.point_clouds import SUFFIXES, PointClouds
from coordinator.sources.realsense_bag import RealSenseBag
from coordinator.sources.recorded_folder import RecordedFolder
from coordinator.sources.source import Source
from coordinator.sources.stereo import LEFT, RIGHT, StereoFolder
from coordinator.sources.tum_rgbd import LIST_FILE, TumFolder
from coordinator.sources.utd_mhad import UtdMhadFile

__all__ = ["ArraySource", "Format", "Source", "find_format", "open_source"]


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of recording: its name, how to know it, and how to open it."""

    name: str
    fits: Callable[[Path], bool]
    open: Callable[[Path], Source]


def has_suffix(suffix: str) -> Callable[[Path], bool]:
    """Whether a path is a file with this suffix."""
    return lambda path: path.is_file() and path.suffix.lower() == suffix


def holds_clouds(path: Path) -> bool:
    """Whether a folder holds point clouds."""
    return path.is_dir() and any(f.suffix.lower() in SUFFIXES for f in path.iterdir())


FORMATS = (
    Format("TUM RGB-D folder (depth.txt)", lambda path: (path / LIST_FILE).is_file(), TumFolder),
    Format(
        "stereo pairs (left/, right/, calibration.yml)",
        lambda path: (path / LEFT).is_dir() and (path / RIGHT).is_dir(),
        StereoFolder,
    ),
    Format("Open3D folder (depth/000000.png)", lambda path: (path / "depth").is_dir(), RecordedFolder),
    Format("point clouds (.ply or .pcd)", holds_clouds, PointClouds),
    Format("RealSense .bag", has_suffix(".bag"), RealSenseBag),
    Format("numpy .npz (depth, intrinsics)", has_suffix(".npz"), read_array_source),
    Format("UTD-MHAD .mat", has_suffix(".mat"), UtdMhadFile),
)
"""In the order in which they are tried."""


def open_source(path: Path | str) -> Source:
    """The sequence at `path`, whatever its format.

    Reads what is needed to know the camera and the frames' numbers. Raises InputError where there is no
    sequence, or where its description is damaged.
    """
    path = Path(path)
    return find_format(path).open(path)


def find_format(path: Path) -> Format:
    """The format of what is at `path`; InputError names all that are read."""
    known = ", ".join(form.name for form in FORMATS)
    try:
        path.stat()
        found = next((form for form in FORMATS if form.fits(path)), None)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"no such file or folder: {path}; give one of: {known}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give another path") from error
    if found is None:
        what = "holds no depth sequence" if path.is_dir() else "is no depth sequence"
        raise InputError(f"{path} {what} that is known here; give one of: {known}")
    return found
