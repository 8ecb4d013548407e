"""A folder of the TUM RGB-D benchmark: depth.txt names pictures by time, 5000 units per metre.

Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems" (IROS 2012). Where the folder has no
camera_intrinsic.json, the camera is the one that the data set documents for its name (freiburg1, 2 or 3),
else the nominal one; all are for 640 x 480.
"""

from __future__ import annotations

import math
from pathlib import Path

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files.names import CAMERA_FILE, START_FILE, TRUTH_FILE
from coordinator.sources.camera_file import NOMINAL, pinhole, read_camera
from coordinator.sources.pictures.depth_picture import picture_size, read_depth
from coordinator.sources.source import Recording, if_there, rate_of

LIST_FILE = "depth.txt"
UNITS_PER_METRE = 5000.0
CAMERAS = {
    "freiburg1": Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
    "freiburg2": Intrinsics(640, 480, 520.9, 521.0, 325.1, 249.7),
    "freiburg3": Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
}


class TumFolder(Recording):
    """The pictures that depth.txt lists, numbered from 0; times are those of the list, from 0."""

    def __init__(self, path: Path) -> None:
        self.name = path.resolve().name
        self._times, self._files = read_list(path / LIST_FILE)
        self._scale = UNITS_PER_METRE
        self.intrinsics = next((c for key, c in CAMERAS.items() if key in self.name), NOMINAL)
        if (path / CAMERA_FILE).exists():
            camera = read_camera(path / CAMERA_FILE)
            self.intrinsics, self._scale = pinhole(camera, path / CAMERA_FILE), camera.depth_scale
        else:
            check_size(self._files[0], self.intrinsics)
        self.numbers = range(len(self._files))
        self.fps = rate_of(self._times)
        self.truth = if_there(path / TRUTH_FILE)
        self.init = if_there(path / START_FILE)

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        time_s = self._times[number] - self._times[0]
        return DepthFrame(number, time_s, depth, self._scale, self.intrinsics)


def check_size(path: Path, camera: Intrinsics) -> None:
    """InputError unless a picture has the size that the data set's cameras have."""
    width, height = picture_size(path)
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"{path} is {width}x{height}, but the camera that the data set documents has "
            f"{camera.width}x{camera.height}; add {CAMERA_FILE} to the folder"
        )


def read_list(path: Path) -> tuple[list[float], list[Path]]:
    """Times in seconds, ascending, and pictures; InputError names the line that is at fault."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; mend its permissions") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text ({error.reason}); copy it again") from error
    times: list[float] = []
    files: list[Path] = []
    for n, line in enumerate(lines, start=1):
        cells = line.split()
        if not cells or line.startswith("#"):
            continue
        time_s = seconds(cells[0]) if len(cells) == 2 else math.nan
        if math.isnan(time_s) or (times and time_s <= times[-1]):
            raise InputError(f"{path}, line {n}: '{line}' is not a later time and a picture; mend that line")
        times.append(time_s)
        files.append(path.parent / cells[1])
    if not files:
        raise InputError(f"{path} lists no picture; copy it again")
    return times, files


def seconds(cell: str) -> float:
    """The number in a cell, NaN where there is none."""
    try:
        value = float(cell)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
