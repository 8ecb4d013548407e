"""Readers of depth sequences: a function per format returns a `Source`; the path determines the format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gepf.common.errors import InputError
from gepf.coordinator.sources.arrays import ArraySource, read_npy, read_npz
from gepf.coordinator.sources.bag import is_bag
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from gepf.coordinator.sources.colour_folder import with_colours
from gepf.coordinator.sources.picture_folders import holds_pictures, is_tum, read_pictures
from gepf.coordinator.sources.point_clouds import SUFFIXES, read_clouds
from gepf.coordinator.sources.rig import read_rig
from gepf.coordinator.sources.ros_bag import read_ros_bag
from gepf.coordinator.sources.source import Source
from gepf.coordinator.sources.utd_mhad import read_utd_mhad

__all__ = ["ArraySource", "Format", "Source", "find_format", "open_source"]


@dataclass(frozen=True, slots=True)
class Format:
    """A format of recordings: its name, a test for a path, and a function that opens it."""

    name: str
    fits: Callable[[Path], bool]
    open: Callable[[Path, GivenCamera], Source]


def open_azure_kinect(path: Path, given: GivenCamera) -> Source:
    """Open an `.mkv` with PyAV, which is slow to load."""
    from gepf.coordinator.sources.azure_kinect import read_azure_kinect

    return read_azure_kinect(path, given)


def holds_clouds(path: Path) -> bool:
    """Whether a folder holds point clouds."""
    return path.is_dir() and any(file.suffix.lower() in SUFFIXES for file in path.iterdir())


def has_suffix(suffix: str) -> Callable[[Path], bool]:
    """Whether a path is a file with this suffix."""
    return lambda path: path.is_file() and path.suffix.lower() == suffix


FORMATS = (
    Format("TUM RGB-D folder (depth.txt)", is_tum, read_pictures),
    Format("ROS 1 or RealSense .bag, ROS 2 .mcap, .db3 or folder", is_bag, read_ros_bag),
    Format("Open3D folder (depth/000000.png)", holds_pictures, read_pictures),
    Format("point clouds (.ply or .pcd)", holds_clouds, read_clouds),
    Format("Azure Kinect or Orbbec .mkv", has_suffix(".mkv"), open_azure_kinect),
    Format("numpy .npz (depth, intrinsics)", has_suffix(".npz"), read_npz),
    Format("rig of several cameras .json", has_suffix(".json"), read_rig),
    Format("numpy .npy", has_suffix(".npy"), read_npy),
    Format("UTD-MHAD .mat", has_suffix(".mat"), read_utd_mhad),
)
"""In the order of the tests."""


DEPTH_PNG = "write depth/000000.png, ... of 16-bit millimetres, and add --intrinsics fx,fy,cx,cy"


def open_source(
    path: Path | str, given: GivenCamera = AS_RECORDED, *, color: bool | Path | str = False
) -> Source:
    """Open the sequence at `path`, in any format; `given` can replace its camera and units.

    With `color`, its frames have those colour images that fit the depth, or those of a folder. Reads only the
    camera and the numbers of the frames. Raises InputError if there is no sequence, or if its description is
    damaged.
    """
    source = open_recording(Path(path), given)
    if color is False:
        return source.without_colours()
    return with_colours(source, None if color is True else Path(color))


def open_recording(path: Path, given: GivenCamera = AS_RECORDED) -> Source:
    """The sequence at `path` with the colour that its file holds."""
    source = find_format(path).open(path, given)
    if given.mirrored is None:
        return source
    return source.mirrored_back() if given.mirrored else source.changed(mirrored=False)


def find_format(path: Path) -> Format:
    """The format of the recording at `path`; InputError lists all formats."""
    known = ", ".join(form.name for form in FORMATS)
    try:
        path.stat()
        found = next((form for form in FORMATS if form.fits(path)), None)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"no such file or folder: {path}; give the path of a recording") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give another path") from error
    if found is None:
        what = "holds no depth sequence" if path.is_dir() else "is not a depth sequence"
        raise InputError(f"{path} {what} of a known format; give one of: {known}; or {DEPTH_PNG}")
    return found
