"""Depth as folders of 16-bit PNG: as Open3D's recorders write it, of the TUM RGB-D benchmark, or any other.

Images are in the order of all numbers in their names, which count frames or are times (`clock`).
Alternatively a text file in the folder holds times: one line for each image in order, or with the name of the
image. Frames may be missing; the others keep their times.

A folder of the TUM benchmark (Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", IROS
2012) lists times and images in depth.txt. Without a camera_intrinsic.json, the camera is the documented one
for the name of the sequence (freiburg1, 2 or 3), else the nominal one; all are for 640 x 480.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.files import CAMERA_FILE, SUMMARY_FILE, read_text
from gepf.coordinator.sources.camera import (
    DEFAULT_FPS,
    MILLIMETRES,
    NOMINAL,
    GivenCamera,
    find_camera_file,
    read_camera,
)
from gepf.coordinator.sources.clock import (
    NUMBER,
    SIGNED,
    columns_of,
    order_of,
    times_in_lines,
    times_in_names,
)
from gepf.coordinator.sources.source import Source, rate_of

logger = logging.getLogger(__name__)

TUM_LIST = "depth.txt"
TIMES_FILE = "timestamps.txt"
TIME_FILES = (TUM_LIST, TIMES_FILE, "times.txt", "depth_timestamps.txt", "timestamps.csv")
TUM_CAMERAS = {
    "freiburg1": Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
    "freiburg2": Intrinsics(640, 480, 520.9, 521.0, 325.1, 249.7),
    "freiburg3": Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
}


def holds_pictures(path: Path) -> bool:
    """Whether a folder holds PNGs, directly or in depth/."""
    return (path / "depth").is_dir() or (path.is_dir() and any(path.glob("*.png")))


def is_tum(path: Path) -> bool:
    """Whether a folder is one of the TUM benchmark."""
    return (path / TUM_LIST).is_file()


def read_pictures(path: Path, given: GivenCamera) -> Source:
    """Read a folder of images; frames have the numbers in the names, or are counted if these are times."""
    folder = path / "depth" if (path / "depth").is_dir() else path
    numbers, files, times = find_frames(folder, path)
    if not files:
        raise InputError(
            f"{path} holds no depth/000000.png; give a folder with depth/*.png and {CAMERA_FILE}"
        )
    name = path.resolve().name
    intrinsics, scale, fps = NOMINAL, MILLIMETRES, DEFAULT_FPS
    if is_tum(path) and find_camera_file(path) is None:
        intrinsics = next((camera for key, camera in TUM_CAMERAS.items() if key in name), NOMINAL)
        scale = 5000.0
    elif given.intrinsics is None or find_camera_file(path) is not None:
        if find_camera_file(path) is None:
            read_depth(files[0])  # for colour images, complain about them, not about the missing camera
        intrinsics, scale, fps = read_camera(path, given)
    if given.intrinsics is not None:
        intrinsics = given.camera(read_depth(files[0]).shape, path)
    if times is not None and len(times) > 1:
        fps = rate_of(times)
    scale = given.depth_scale or scale
    return Source(name, intrinsics, numbers, lambda n: read_depth(files[n]), scale, fps, times, folder=path)


def find_frames(
    folder: Path, beside: Path, suffixes: Collection[str] = (".png",)
) -> tuple[Sequence[int], list[Path], list[float] | None]:
    """Numbers, files and times of a folder's frames, ascending; times are None if names count frames.

    `beside` is another folder that may hold a file with times. Raises InputError for names without a number,
    or decreasing times.
    """
    files = ordered_files(folder, suffixes)
    listed = next((p for place in (beside, folder) for n in TIME_FILES if (p := place / n).is_file()), None)
    if listed is None:
        found = times_in_names([file.stem for file in files])
        times = None if found is None else found.seconds
        if found is not None and found.written not in ("seconds", "dates"):
            logger.warning("%s: names are read as times: %s", folder, found.written)
    else:
        files, times = listed_times(listed, files)
    if times is not None and np.any(np.diff(times) <= 0.0):
        late = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise InputError(f"{listed or folder}: frame {late} is not later than the last; correct its time")
    counts = columns_of([NUMBER.findall(file.stem) for file in files])
    values = [*map(Decimal, counts[0])] if len(counts) == 1 else []
    if len(files) == 1:
        values = [*order_of(files[0].stem)[-1:]]
    if (times is not None and listed is None) or not values or any(value % 1 for value in values):
        return range(len(files)), files, times
    numbers = [int(value) for value in values]
    gap = next((a + 1 for a, b in pairwise(numbers) if b > a + 1), None)
    if gap is not None:
        whole = numbers[-1] - numbers[0] + 1
        logger.warning(
            "%s: %d of %d frames are missing, frame %d first; the others keep their times",
            folder, whole - len(numbers), whole, gap,
        )  # fmt: skip
        return numbers, files, times
    return range(numbers[0], numbers[0] + len(numbers)), files, times


def ordered_files(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Files in the order of all numbers in their names."""
    try:
        files = [f for f in folder.iterdir() if f.suffix.lower() in suffixes and not f.name.startswith(".")]
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}; change its permissions") from error
    numbered: dict[tuple[Decimal, ...], Path] = {}
    for file in sorted(files):
        key = order_of(file.stem)
        if not key and (folder / SUMMARY_FILE).exists():
            raise InputError(f"{folder} is the folder of a run; give the recording that was tracked")
        if not key and len(files) > 1:
            raise InputError(f"{file} has no frame number in its name, such as 000000; rename or remove it")
        if key in numbered:
            raise InputError(
                f"{folder} has a frame number twice ({numbered[key].name}, {file.name}); keep one"
            )
        numbered[key] = file
    return [numbered[key] for key in sorted(numbered)]


def listed_times(path: Path, files: list[Path]) -> tuple[list[Path], list[float]]:
    """The images that a file names, or all if it names none, and the time of each, seconds from 0."""
    try:
        lines = [re.split(r"[,;\s]+", line.strip()) for line in read_text(path).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not a readable text file ({error}); copy it again") from error
    rows = [cells for cells in lines if any(cells) and not cells[0].startswith("#")]
    by_name = {Path(cell).name: cells for cells in rows if len(cells) > 1 for cell in cells}
    named = [file for file in files if file.name in by_name]
    if named:
        files = named
        rows = [[c for c in by_name[file.name] if Path(c).name != file.name] for file in files]
    elif len(rows) > len(files) and not any(map(SIGNED.fullmatch, rows[0])):  # names of columns
        rows = rows[1:]
    if len(rows) != len(files):
        raise InputError(f"{path} has {len(rows)} times for {len(files)} pictures; write one line for each")
    found = times_in_lines(rows)
    if found is not None:
        if found.written not in ("seconds", "dates"):
            logger.warning("%s: times are read as %s", path, found.written)
        return files, found.seconds
    try:
        times = [float(cells[0]) for cells in rows]
    except ValueError as error:
        raise InputError(f"{path}: {error}; write times in seconds") from error
    return files, [time - times[0] for time in times]


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Depth (H, W) of a 16-bit PNG; InputError if it is damaged or has another type."""
    with opened(path, "PNG") as image:
        if image.mode != "I;16":
            kind = {"1": "1-bit", "L": "8-bit"}.get(image.mode, f"of kind {image.mode}")
            raise InputError(f"{path} is {kind}, not 16-bit grey; save depth as uint16")
        image.verify()  # all checksums: decoding alone accepts truncated or altered files
    with opened(path, "PNG") as image:
        return np.asarray(image).astype(np.uint16, copy=False)


@contextmanager
def opened(path: Path, *formats: str) -> Iterator[Image.Image]:
    """An image of one of the formats; InputError if it is damaged."""
    try:
        with Image.open(path, formats=formats) as image:
            yield image
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        reason = "cut short or not a picture" if "cannot identify" in reason else reason
        kind = " or ".join(formats)
        raise InputError(f"{path} is damaged or not a {kind} file ({reason}); copy it again") from error
