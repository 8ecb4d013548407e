"""Depth as folders of 16-bit PNG: as Open3D's recorders write it, of the TUM RGB-D benchmark, or any other.

Names of pictures end in a number: the frame's, or, if the numbers are far apart, its time in seconds,
microseconds or nanoseconds. A text file beside the pictures may hold times instead: one a line, in seconds,
for each picture in their order, or with the picture's name before or after it. Frames may be missing: the
others keep their times.

A folder of the TUM benchmark (Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", IROS
2012) lists times and pictures in depth.txt. Where it has no camera_intrinsic.json, the camera is the one that
the data set documents for its name (freiburg1, 2 or 3), else the nominal one; all are for 640 x 480.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from common.errors import InputError
from coordinator.files import CAMERA_FILE
from coordinator.sources.camera import DEFAULT_FPS, MILLIMETRES, NOMINAL, CameraOptions, read_camera
from coordinator.sources.source import Source, rate_of

logger = logging.getLogger(__name__)

SIXTEEN_BIT_GREY = "I;16"
TUM_LIST = "depth.txt"
TIME_FILES = (TUM_LIST, "timestamps.txt", "times.txt", "depth_timestamps.txt")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?=\D*$)")
SHORTEST_FRAME_US = 3000.0
"""Steps between the numbers in names that are longer are micro- or nanoseconds: 300 frames a second."""
LONGEST_FRAME_US = 2e6
"""And those that are longer than this are nanoseconds."""

TUM_UNITS_PER_METRE = 5000.0
TUM_CAMERAS = {
    "freiburg1": Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
    "freiburg2": Intrinsics(640, 480, 520.9, 521.0, 325.1, 249.7),
    "freiburg3": Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
}


def holds_pictures(path: Path) -> bool:
    """Whether a folder holds PNGs, here or in depth/."""
    return (path / "depth").is_dir() or (path.is_dir() and any(path.glob("*.png")))


def is_tum(path: Path) -> bool:
    """Whether a folder is one of the TUM benchmark."""
    return (path / TUM_LIST).is_file()


def read_pictures(path: Path, options: CameraOptions) -> Source:
    """A folder of pictures; frames have the numbers of the files, or are counted where these are times."""
    folder = path / "depth" if (path / "depth").is_dir() else path
    numbers, files, times = find_frames(folder, path)
    if not files:
        raise InputError(
            f"{path} holds no depth/000000.png; give a folder as Open3D's recorders write it "
            f"(depth/*.png and {CAMERA_FILE})"
        )
    name = path.resolve().name
    if is_tum(path):
        camera = next((camera for key, camera in TUM_CAMERAS.items() if key in name), NOMINAL)
        scale, described = TUM_UNITS_PER_METRE, True
    else:
        camera, scale, described = NOMINAL, MILLIMETRES, options.intrinsics is not None
    fps = DEFAULT_FPS
    if (path / CAMERA_FILE).exists() or not described:
        camera, scale, fps = read_camera(path / CAMERA_FILE)
    if options.intrinsics is not None:
        camera = options.camera(read_depth(files[0]).shape, path)
    if times is not None and len(times) > 1:
        fps = rate_of(times)
    scale = options.depth_scale or scale
    return Source(name, camera, numbers, lambda n: read_depth(files[n]), scale, fps, times, folder=path)


def find_frames(folder: Path, beside: Path) -> tuple[Sequence[int], list[Path], list[float] | None]:
    """Numbers, files and times (None where names count frames) of a folder's frames, ascending.

    `beside` is where a file with times may be, besides in the folder. Raises InputError for names that have
    no number, or times that go back.
    """
    files = sorted_by_number(folder)
    listed = next((p for place in (beside, folder) for n in TIME_FILES if (p := place / n).is_file()), None)
    if listed is None:
        times = times_in_names(list(files))
    else:
        files, times = listed_times(listed, files)
    if times is not None and np.any(np.diff(times) <= 0.0):
        late = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise InputError(
            f"{listed or folder}: the time of frame {late} is not after the one before; correct it"
        )
    if (times is not None and listed is None) or not all(value.is_integer() for value in files):
        return range(len(files)), list(files.values()), times
    numbers = [int(value) for value in files]
    missing = sorted({*range(numbers[0], numbers[-1])} - {*numbers}) if numbers else []
    if missing:
        logger.warning(
            "%s: %d of %d frames are missing, frame %d first; the others keep their times",
            folder, len(missing), len(missing) + len(numbers), missing[0],
        )  # fmt: skip
        return numbers, list(files.values()), times
    return range(numbers[0], numbers[0] + len(numbers)) if numbers else range(0), list(files.values()), times


def sorted_by_number(folder: Path) -> dict[float, Path]:
    """Files by the number in their names, ascending."""
    try:
        files = [f for f in folder.iterdir() if f.suffix.lower() == ".png" and not f.name.startswith(".")]
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}; change its permissions") from error
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


def listed_times(path: Path, files: dict[float, Path]) -> tuple[dict[float, Path], list[float]]:
    """The pictures that a file names, or all where it names none, and a time for each, seconds from 0."""
    try:
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no text that can be read ({error}); copy it again") from error
    rows = [cells for cells in lines if cells and not cells[0].startswith("#")]
    by_name = {Path(cell).name: cells for cells in rows if len(cells) > 1 for cell in cells}
    named = {value: file for value, file in files.items() if file.name in by_name}
    if named:
        files = named
        rows = [[c for c in by_name[file.name] if Path(c).name != file.name] for file in files.values()]
    if len(rows) != len(files):
        raise InputError(f"{path} has {len(rows)} times for {len(files)} pictures; write one line for each")
    try:
        times = [float(cells[0]) for cells in rows]
    except ValueError as error:
        raise InputError(f"{path}: {error}; write times in seconds") from error
    return files, [time - times[0] for time in times]


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Depth (H, W) of a 16-bit PNG; InputError if it is damaged or of another kind."""
    with opened(path) as image:
        if image.mode != SIXTEEN_BIT_GREY:
            kind = {"1": "1-bit", "L": "8-bit"}.get(image.mode, f"of kind {image.mode}")
            raise InputError(
                f"{path} is {kind}, not 16-bit grey; save depth as uint16 with depth_scale units per metre"
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
