"""Order and times of frames by the numbers in the names of files, or in the lines of a list.

Files are in the order of all numbers in their names, compared one after another. Recorders write times as one
number, as seconds and their fraction, or as a date and a time of day, some with an index beside it. The unit
is the only plausible one: cameras give 0.3 to 300 frames per second, and as these limits differ by a factor
of 1000, like the units, only one unit fits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from decimal import Decimal
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np

NUMBER = re.compile(r"\d+(?:\.\d+)?")
SIGNED = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
DATE = re.compile(
    r"((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]*(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)(?:[-_.,s]?(\d+))?"
)

UNITS = {"seconds": Decimal(1), "milliseconds": Decimal("1e-3"), "microseconds": Decimal("1e-6"),
         "nanoseconds": Decimal("1e-9")}  # fmt: skip
SECOND_NS = 1_000_000_000


class ClockLimits(msgspec.Struct, frozen=True):
    """What distinguishes times of frames from numbers that count frames."""

    min_step_s: float = 1.0 / 300.0  #: shortest plausible time between frames
    max_step_s: float = 10.0 / 3.0  #: longest plausible time between frames
    epoch: float = 1e9  #: larger numbers are times since 1970, in seconds (2001 to 2096) or smaller units
    max_counted_step: float = 3000.0  #: numbers with larger steps do not count frames
    min_step_ms: float = 8.0  #: between frames; if they are faster, milliseconds look like numbers of frames


CLOCK = ClockLimits()


class Times(NamedTuple):
    """Times of frames in seconds from the first, and in words how they are written."""

    seconds: list[float]
    written: str


def order_of(name: str) -> tuple[Decimal, ...]:
    """The key by which names are ordered: all numbers in a name."""
    return tuple(map(Decimal, NUMBER.findall(name)))


def is_plausible(step_s: float) -> bool:
    """Whether frames of a camera may be so far apart."""
    return CLOCK.min_step_s <= step_s < CLOCK.max_step_s


def median_step(values: Sequence[Decimal]) -> float:
    """The median difference of successive values."""
    return float(np.median([float(b - a) for a, b in pairwise(values)]))


def ascends(values: Sequence[Decimal]) -> bool:
    """Whether every value is above the last."""
    return all(b > a for a, b in pairwise(values))


def times_in_names(names: Sequence[str]) -> Times | None:
    """The times in names of files that are in order; None if their numbers count frames."""
    columns = columns_of([NUMBER.findall(name) for name in names])
    counted = (column for column in columns[::-1] if is_clock(column))
    return find_times(names, columns, counted)


def times_in_lines(lines: Sequence[Sequence[str]]) -> Times | None:
    """The times in the cells of lines, at least one of which is a time; None if no column of numbers ascends.

    A column that counts is an index, unless it is the only one.
    """
    columns = columns_of([[cell for cell in cells if SIGNED.fullmatch(cell)] for cells in lines])
    ascending = [column for column in columns if ascends([*map(Decimal, column)])]
    clocks = [
        column for column in ascending if median_step([*map(Decimal, column)]) != 1.0 or has_points(column)
    ]
    return find_times([" ".join(cells) for cells in lines], columns, iter(clocks or ascending))


def columns_of(rows: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    """The numbers that differ from row to row, one column for each; none if rows have several lengths."""
    if len(rows) < 2 or len(set(map(len, rows))) > 1:
        return []
    return [column for column in zip(*rows, strict=True) if len(set(column)) > 1]


def find_times(
    texts: Sequence[str], columns: Sequence[tuple[str, ...]], clocks: Iterator[tuple[str, ...]]
) -> Times | None:
    """Times by dates in the texts, by seconds and their fraction in two columns, else by a clock's column."""
    if len(texts) < 2:
        return None
    for values, written in readings(texts, columns):
        if ascends(values) and is_plausible(median_step(values)):
            return Times(from_first(values), written)
    clock = next(clocks, None)
    if clock is None:
        return None
    values = [*map(Decimal, clock)]
    unit = unit_of(values)
    return Times(from_first([value * UNITS[unit] for value in values]), unit)


def readings(texts: Sequence[str], columns: Sequence[tuple[str, ...]]) -> Iterator[tuple[list[Decimal], str]]:
    """Seconds as dates in the texts, and as seconds and their fraction in two successive columns."""
    dates = [DATE.search(text) for text in texts]
    found = [date.groups() for date in dates if date is not None]
    if len(found) == len(texts):
        parts = fractions([date[6] or "0" for date in found])
        days = [day for date in found if (day := since_1970(date[:6])) is not None]
        if len(days) == len(texts):
            yield [Decimal(day) + part for day, part in zip(days, parts, strict=True)], "dates"
    for whole, part in pairwise(columns):
        width, index = max(map(len, part)), median_step([*map(Decimal, whole)]) >= 1.0
        clock = width <= 9 and (float(whole[0]) >= CLOCK.epoch or (width >= 6 and not index))
        if clock and not has_points(whole) and not has_points(part):
            pairs = zip(whole, fractions(part), strict=True)
            yield [Decimal(second) + share for second, share in pairs], "seconds and their fraction"


def since_1970(date: Sequence[str]) -> int | None:
    """Seconds of a date; None if there is no such date."""
    try:
        year, month, day, hour, minute, second = map(int, date)
        return int(datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp())
    except ValueError:
        return None


def fractions(digits: Sequence[str]) -> list[Decimal]:
    """Fractions of a second: decimals if they begin with zeros, else milli-, micro- or nanoseconds."""
    width = max(map(len, digits))
    padded = len(set(map(len, digits))) == 1 and any(each.startswith("0") for each in digits)
    places = width if padded else 3 * -(-width // 3)
    return [Decimal(each) / 10**places for each in digits]


def has_points(column: Sequence[str]) -> bool:
    """Whether a column has numbers that are not whole."""
    return any(Decimal(value) % 1 for value in column)


def is_clock(column: Sequence[str]) -> bool:
    """Whether the numbers of names are times, as they do not count frames.

    They are not whole, or since 1970, or far apart, or nearly equally far apart.
    """
    values = [*map(Decimal, column)]
    if not ascends(values):
        return False
    if has_points(column) or values[0] >= CLOCK.epoch or median_step(values) >= CLOCK.max_counted_step:
        return True
    steps = np.diff([float(value) for value in values])
    low, middle, high = np.quantile(steps, [0.2, 0.5, 0.8])
    return bool(middle >= CLOCK.min_step_ms and len(steps) > 2 and 0.0 < high - low < 0.5 * middle)


def unit_of(values: Sequence[Decimal]) -> str:
    """The unit of times: by their size if they are since 1970, else by the median step."""
    exponent = float(np.log10(float(values[0]) / CLOCK.epoch)) / 3.0 if values[0] >= CLOCK.epoch else -1.0
    names = [*UNITS]
    if 0.0 <= exponent < len(names):
        return names[int(exponent)]
    step = median_step(values)
    return next((name for name in names if is_plausible(step * float(UNITS[name]))), names[0])


def from_first(seconds: Sequence[Decimal]) -> list[float]:
    """Seconds from the first time."""
    return [float(value - seconds[0]) for value in seconds]
