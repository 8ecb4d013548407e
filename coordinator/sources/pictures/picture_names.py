"""Which pictures of a folder are frames, what their numbers are, and when they were taken.

Names end in a number: the frame's, or, if the numbers are far apart, its time in seconds, microseconds or
nanoseconds. A text file beside the pictures may hold times instead: one a line, in seconds, for each picture
in their order, or with the picture's name before or after it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.errors import InputError

TIME_FILES = ("timestamps.txt", "times.txt", "depth_timestamps.txt")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?=\D*$)")
FAR_APART = 3000.0
"""Steps between numbers that are longer than this are microseconds or nanoseconds: at 300 frames a second."""
NANOSECOND_STEPS = 2e6


@dataclass(frozen=True, slots=True)
class Picture:
    """A frame: its number, its file, and when it was taken, seconds; None where there is only its number."""

    number: int
    file: Path
    time_s: float | None


def find_pictures(folder: Path, beside: Path) -> list[Picture]:
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
    elif step < FAR_APART:
        return None
    else:
        unit = 1e-9 if step > NANOSECOND_STEPS else 1e-6
    return [(value - values[0]) * unit for value in values]


def listed_times(path: Path, names: list[str]) -> list[float]:
    """Seconds for each name; InputError that says what is wrong with the file."""
    try:
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as text ({error}); copy it again") from error
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
