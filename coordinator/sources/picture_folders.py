"""Depth as folders of 16-bit PNG: as Open3D's recorders write it, of the TUM RGB-D benchmark, or any other.

Names of pictures end in a number: the frame's, or, if the numbers are far apart, its time in seconds,
microseconds or nanoseconds. A text file beside the pictures may hold times instead: one a line, in seconds,
for each picture in their order, or with the picture's name before or after it. Frames may be missing: the
others keep their times.

A folder of the TUM benchmark (Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", IROS
2012) lists its pictures in depth.txt. Where it has no camera_intrinsic.json, the camera is the one that the
data set documents for its name (freiburg1, 2 or 3), else the nominal one; all are for 640 x 480.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files import CAMERA_FILE
from coordinator.sources.camera import (
    AS_RECORDED,
    DEFAULT_FPS,
    MILLIMETRES,
    NOMINAL,
    CameraOptions,
    read_camera,
)
from coordinator.sources.source import FolderRecording, rate_of

SIXTEEN_BIT_GREY = "I;16"
TIME_FILES = ("timestamps.txt", "times.txt", "depth_timestamps.txt")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?=\D*$)")
SHORTEST_FRAME_US = 3000.0
"""Steps between the numbers in names that are longer are micro- or nanoseconds: 300 frames a second."""
LONGEST_FRAME_US = 2e6
"""And those that are longer than this are nanoseconds."""


def read_depth(path: Path, camera: Intrinsics) -> NDArray[np.uint16]:
    """Depth (H, W) of a 16-bit PNG; InputError if it is damaged, of another depth or another size."""
    with opened(path) as image:
        if image.mode != SIXTEEN_BIT_GREY:
            kind = {"1": "1-bit", "L": "8-bit"}.get(image.mode, f"of kind {image.mode}")
            raise InputError(
                f"{path} is {kind}, not 16-bit grey; save depth as uint16 with depth_scale units per metre"
            )
        if image.size != (camera.width, camera.height):
            width, height = image.size
            raise InputError(
                f"{path} is {width}x{height}, but {CAMERA_FILE} says {camera.width}x{camera.height}; "
                "all frames must have the camera's size"
            )
        image.verify()  # all checksums: decoding alone lets a missing end and altered last bytes pass
    with opened(path) as image:
        return np.asarray(image).astype(np.uint16, copy=False)


@contextmanager
def opened(path: Path) -> Iterator[Image.Image]:
    """A PNG; InputError if it is damaged."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            yield image
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        reason = "cut short or not a picture" if "cannot identify" in reason else reason
        raise InputError(f"{path} is damaged or no PNG ({reason}); copy it again") from error


@dataclass(frozen=True, slots=True)
class Picture:
    """A frame: its number, its file, and when it was taken, seconds; None where there is only its number."""

    number: int
    file: Path
    time_s: float | None


def find_frames(folder: Path, beside: Path) -> list[Picture]:
    """All frames of a folder, ascending; InputError for names that have no number, or times that go back.

    `beside` is where a file with times may be, besides in the folder.
    """
    files = sorted_by_number(folder)
    listed = next((p for place in (folder, beside) for n in TIME_FILES if (p := place / n).is_file()), None)
    values = list(files)
    if listed is not None:
        times: list[float] | None = listed_times(listed, [file.name for file in files.values()])
    else:
        times = times_in_names(values)
    if times is None:
        return [Picture(int(value), file, None) for value, file in files.items()]
    if np.any(np.diff(times) <= 0.0):
        late = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise InputError(f"{listed or folder}: the time of frame {late} is not after the one before; mend it")
    whole = listed is not None and all(float(value).is_integer() for value in values)
    numbers = [int(value) for value in values] if whole else range(len(files))
    return [
        Picture(number, file, time) for number, file, time in zip(numbers, files.values(), times, strict=True)
    ]


def sorted_by_number(folder: Path) -> dict[float, Path]:
    """Files by the number in their names, ascending."""
    try:
        files = [f for f in folder.iterdir() if f.suffix.lower() == ".png" and not f.name.startswith(".")]
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}; mend its permissions") from error
    numbered: dict[float, Path] = {}
    for file in sorted(files):
        found = NUMBER.search(file.stem)
        if found is None:
            raise InputError(f"{file} is not named by a frame number such as 000000.png; rename or remove it")
        value = float(found.group())
        if value in numbered:
            raise InputError(
                f"{folder} names a frame number twice ({numbered[value].name}, {file.name}); remove one"
            )
        numbered[value] = file
    return dict(sorted(numbered.items()))


def times_in_names(values: list[float]) -> list[float] | None:
    """Seconds, where the numbers in names are times; None where they count frames."""
    if len(values) < 2:
        return None
    step = float(np.median(np.diff(values)))
    if any(not value.is_integer() for value in values):
        unit = 1.0
    elif step < SHORTEST_FRAME_US:
        return None
    else:
        unit = 1e-9 if step > LONGEST_FRAME_US else 1e-6
    return [(value - values[0]) * unit for value in values]


def listed_times(path: Path, names: list[str]) -> list[float]:
    """Seconds for each name; InputError that says what is wrong with the file."""
    lines = [line.split() for line in read_lines(path)]
    rows = [cells for cells in lines if cells and not cells[0].startswith("#")]
    by_name = {Path(cell).name: cells for cells in rows if len(cells) > 1 for cell in cells}
    if any(name in by_name for name in names):
        missing = next((name for name in names if name not in by_name), None)
        if missing is not None:
            raise InputError(f"{path} has no time for {missing}; add a line for it")
        rows = [[c for c in by_name[name] if Path(c).name != name] for name in names]
    if len(rows) != len(names):
        raise InputError(f"{path} has {len(rows)} times for {len(names)} pictures; write one line for each")
    try:
        times = [float(cells[0]) for cells in rows]
        return [time - times[0] for time in times]
    except ValueError as error:
        raise InputError(f"{path}: {error}; write times in seconds") from error


logger = logging.getLogger(__name__)


class RecordedFolder(FolderRecording):
    """A depth sequence in a folder; `numbers` are those of the files, or counted where these are times."""

    def __init__(self, path: Path, options: CameraOptions = AS_RECORDED) -> None:
        super().__init__(path)
        folder = path / "depth" if (path / "depth").is_dir() else path
        pictures = find_frames(folder, path)
        if not pictures:
            raise InputError(
                f"{path} holds no depth/000000.png; give a folder as Open3D's recorders write it "
                f"(depth/*.png and {CAMERA_FILE})"
            )
        self.depth_scale, self.fps = options.depth_scale or MILLIMETRES, DEFAULT_FPS
        if options.intrinsics is None or (path / CAMERA_FILE).exists():
            self.intrinsics, depth_scale, self.fps = read_camera(path / CAMERA_FILE)
            self.depth_scale = options.depth_scale or depth_scale
        if options.intrinsics is not None:
            with opened(pictures[0].file) as image:
                self.intrinsics = options.camera(*image.size, str(path))
        self._files = {picture.number: picture.file for picture in pictures}
        times = [picture.time_s for picture in pictures if picture.time_s is not None]
        self._times = {p.number: t for p, t in zip(pictures, times, strict=False)}
        self.fps = rate_of(times) if len(times) > 1 else self.fps
        first, last = pictures[0].number, pictures[-1].number
        whole = last - first + 1 == len(pictures)
        self.numbers = range(first, last + 1) if whole else tuple(self._files)
        if not whole:
            missing = next(number for number in range(first, last) if number not in self._files)
            logger.warning(
                "%s: %d of %d frames are missing, frame %d first; the others keep their times",
                folder, last - first + 1 - len(pictures), last - first + 1, missing,
            )  # fmt: skip

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        time_s = self._times.get(number, number / self.fps)
        return DepthFrame(number, time_s, depth, self.depth_scale, self.intrinsics)


def holds_pictures(path: Path) -> bool:
    """Whether a folder holds PNGs, here or in depth/."""
    return (path / "depth").is_dir() or (path.is_dir() and any(path.glob("*.png")))


TUM_LIST = "depth.txt"
TUM_UNITS_PER_METRE = 5000.0
TUM_CAMERAS = {
    "freiburg1": Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
    "freiburg2": Intrinsics(640, 480, 520.9, 521.0, 325.1, 249.7),
    "freiburg3": Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
}


class TumFolder(FolderRecording):
    """The pictures that depth.txt lists, numbered from 0; times are those of the list, from 0."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._times, self._files = read_list(path / TUM_LIST)
        self._scale = TUM_UNITS_PER_METRE
        self.intrinsics = next((c for key, c in TUM_CAMERAS.items() if key in self.name), NOMINAL)
        if (path / CAMERA_FILE).exists():
            self.intrinsics, self._scale, _ = read_camera(path / CAMERA_FILE)
        else:
            self._check_size()
        self.numbers = range(len(self._files))
        self.fps = rate_of(self._times)

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        time_s = self._times[number] - self._times[0]
        return DepthFrame(number, time_s, depth, self._scale, self.intrinsics)

    def _check_size(self) -> None:
        """InputError unless the pictures have the size that the data set's cameras have."""
        camera = self.intrinsics
        with opened(self._files[0]) as image:
            width, height = image.size
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                f"{self._files[0]} is {width}x{height}, but the camera that the data set documents has "
                f"{camera.width}x{camera.height}; add {CAMERA_FILE} to the folder"
            )


def read_list(path: Path) -> tuple[list[float], list[Path]]:
    """Times in seconds, ascending, and pictures; InputError names the line that is at fault."""
    times: list[float] = []
    files: list[Path] = []
    for n, line in enumerate(read_lines(path), start=1):
        cells = line.split()
        if not cells or line.startswith("#"):
            continue
        try:
            time_s = float(cells[0]) if len(cells) == 2 else math.nan
        except ValueError:
            time_s = math.nan
        if not (math.isfinite(time_s) and (not times or time_s > times[-1])):
            raise InputError(f"{path}, line {n}: '{line}' is not a later time and a picture; mend that line")
        times.append(time_s)
        files.append(path.parent / cells[1])
    if not files:
        raise InputError(f"{path} lists no picture; copy it again")
    return times, files


def read_lines(path: Path) -> list[str]:
    """A text's lines; InputError if it is none."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no text that can be read ({error}); copy it again") from error
