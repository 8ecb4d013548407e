"""One angle, or what slides, over time as a small SVG drawing: a curve, a band about it, and shaded times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HEIGHT = 150.0
LEFT, RIGHT, TOP, BOTTOM = 38.0, 8.0, 22.0, 20.0  # margins
MOST_TICKS = 5
DEGREES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0)
CENTIMETRES = tuple(unit * power for power in (0.01, 0.1, 1, 10, 100, 1000) for unit in (1.0, 2.0, 5.0))
SECONDS = tuple(unit * power for power in (0.001, 0.01, 0.1, 1, 10, 100, 1000, 10000) for unit in (1, 2, 5))
THINNED = 3  # points for each unit of width, of the longest recordings


@dataclass(frozen=True, slots=True)
class Unit:
    """What values are in: its sign, if it is short, steps between lines, the least that is spanned."""

    sign: str
    steps: tuple[float, ...]
    least_range: float


DEGREE = Unit("°", DEGREES, 1.0)
CENTIMETRE = Unit("", CENTIMETRES, 0.1)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A value (F,) in its unit with its deviation, both NaN where nothing is known, at F times in seconds."""

    name: str
    time_s: Array
    value: Array
    deviation: Array
    doubtful: Mask
    unit: Unit = DEGREE

    @property
    def reach(self) -> tuple[float, float]:
        """Least and greatest of all that is drawn."""
        band = np.where(np.isfinite(self.deviation), self.deviation, 0.0)
        ends = np.concatenate([self.value - band, self.value + band])
        ends = ends[np.isfinite(ends)]
        return (float(ends.min()), float(ends.max())) if len(ends) else (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Scale:
    """Maps values between `least` and `greatest` to lengths between `start` and `end`."""

    least: float
    greatest: float
    start: float
    end: float

    def __call__(self, values: Array) -> Array:
        """Where values (N,) are drawn."""
        return self.start + (values - self.least) / (self.greatest - self.least) * (self.end - self.start)


def draw_curve(curve: Curve, reach: tuple[float, float], width: float) -> Markup:
    """The drawing; `reach` is what its height shows, so that several can share them."""
    across = scale(
        float(curve.time_s.min()), float(curve.time_s.max()), LEFT, width - RIGHT, least_range=1e-3
    )
    up = scale(*reach, HEIGHT - BOTTOM, TOP, least_range=curve.unit.least_range)
    parts = [
        f'<svg class="curve" viewBox="0 0 {width:g} {HEIGHT:g}" role="img">',
        f'<text class="name" x="{LEFT:g}" y="14">{escape(curve.name)}</text>',
        *draw_grid(across, up, curve.unit),
        *draw_doubts(curve, across),
        *draw_band(curve, across, up, width),
        *draw_line(curve, across, up, width),
        "</svg>",
    ]
    return Markup("".join(parts))


def scale(least: float, greatest: float, start: float, end: float, *, least_range: float) -> Scale:
    """From `least` to `greatest`, about their middle if they are too close."""
    middle, half = (least + greatest) / 2.0, max(greatest - least, least_range) / 2.0
    return Scale(middle - half, middle + half, start, end)


def draw_grid(across: Scale, up: Scale, unit: Unit) -> Iterator[str]:
    """Values with lines, seconds below."""
    for height, text in ticks(up, unit.steps):
        yield f'<path class="grid" d="M{LEFT:g} {height:.1f}H{across.end:g}"/>'
        yield f'<text class="degrees" x="{LEFT - 5:g}" y="{height + 4:.1f}">{text}{unit.sign}</text>'
    for second, text in ticks(across, SECONDS):
        yield f'<text class="seconds" x="{second:.1f}" y="{HEIGHT - 5:g}">{text} s</text>'


def ticks(on: Scale, steps: tuple[float, ...]) -> Iterator[tuple[float, str]]:
    """Where round numbers are on a scale, a few of them, and what they are called."""
    span = on.greatest - on.least
    widest = steps[-1] * np.ceil(span / (MOST_TICKS * steps[-1]))
    step = next((each for each in steps if span / each <= MOST_TICKS), widest)
    first, last = int(np.ceil(on.least / step)), int(np.floor(on.greatest / step))
    for number in range(first, last + 1):
        yield float(on(np.array([number * step]))[0]), f"{number * step:.3f}".rstrip("0").rstrip(".")


def draw_doubts(curve: Curve, across: Scale) -> Iterator[str]:
    """A shade over each stretch of doubtful frames, half a frame wider to either side."""
    between = across((curve.time_s[1:] + curve.time_s[:-1]) / 2.0)
    edges = np.concatenate([[across.start], between, [across.end]])
    for first, last in stretches(curve.doubtful):
        box = f"M{edges[first]:.1f} {TOP:g}H{edges[last]:.1f}V{HEIGHT - BOTTOM:g}H{edges[first]:.1f}Z"
        yield f'<path class="doubt" d="{box}"/>'


def draw_band(curve: Curve, across: Scale, up: Scale, width: float) -> Iterator[str]:
    """One deviation to either side."""
    for first, last in stretches(np.isfinite(curve.value + curve.deviation)):
        at = np.arange(first, last)
        above, below = (curve.value + sign * curve.deviation for sign in (1.0, -1.0))
        there, back = (thin(at, ends, width) for ends in (above, below))
        outline = np.concatenate([there, back[::-1]])
        ends = np.concatenate([above[there], below[back[::-1]]])
        yield f'<path class="band" d="{path(across(curve.time_s[outline]), up(ends))}Z"/>'


def draw_line(curve: Curve, across: Scale, up: Scale, width: float) -> Iterator[str]:
    """The value itself."""
    for first, last in stretches(np.isfinite(curve.value)):
        at = thin(np.arange(first, last), curve.value, width)
        yield f'<path class="line" d="{path(across(curve.time_s[at]), up(curve.value[at]))}"/>'


def stretches(chosen: Mask) -> Iterator[tuple[int, int]]:
    """First and one past the last of every run of chosen frames."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def thin(at: NDArray[np.int64], values: Array, width: float) -> NDArray[np.int64]:
    """Of frames `at`, those that tell apart on so much width: ends and extremes of many parts."""
    if len(at) <= THINNED * width:
        return at
    kept = {int(at[0]), int(at[-1])}
    for part in np.array_split(at, int(width)):
        kept |= {int(part[np.argmin(values[part])]), int(part[np.argmax(values[part])])}
    return np.array(sorted(kept))


def path(x: Array, y: Array) -> str:
    """Lines through points (N,), (N,); a dot, by its round ends, where there is one alone."""
    if len(x) == 1:
        return f"M{x[0]:.1f} {y[0]:.1f}h0"
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
