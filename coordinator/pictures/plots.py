"""Plots over time: their look, angles and sliding joints, and errors where the truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from coordinator.results.angles import Slides
from coordinator.results.evaluation import LOST_M, NEAR_M, Errors, Truth, compare, known_mean
from coordinator.results.track import Track

Array = NDArray[np.float64]

REPORTED, HYPOTHESIS, TRUE = "#e8590c", "#3b82c4", "#1b1f27"
STATUS = {
    "tracked": "#5cc878",
    "ambiguous": "#f5be46",
    "lost": "#f05a5a",
    "searching": "#c86edc",
    "absent": "#969696",
}
SIDES = ("right_", "left_")

STYLE: Mapping[str, Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e4e7ec",
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "gepf",  # equal drawings give equal text
}


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure that needs no display."""
    return Figure(figsize=(width_in, height_in), dpi=120, layout="constrained")


def styled() -> Any:
    """Context in which figures have this look, and are saved with it."""
    return mpl.rc_context(cast("Any", STYLE))


def plain(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names as a person writes them."""
    return tuple(name.replace("_", " ") for name in names)


def edges(time_s: Array) -> Array:
    """Where each frame's share of a time axis begins, and the last one's ends (F + 1,), seconds."""
    steps = np.diff(time_s)
    half = 0.5 * float(np.median(steps)) if len(steps) else 0.5
    between = time_s[:-1] + 0.5 * steps
    return np.concatenate([[time_s[0] - half], between, [time_s[-1] + half]])


def draw_status(axes: Axes, time_s: Array, status: NDArray[np.str_]) -> None:
    """Fill a strip with the colour of each frame's status, and name those that occur."""
    ends = edges(time_s)
    for name, colour in STATUS.items():
        spans = [(ends[f], ends[f + 1] - ends[f]) for f in np.flatnonzero(status == name)]
        axes.broken_barh(spans, (0, 1), color=colour, linewidth=0, antialiased=False)
    axes.set(ylim=(0, 1), yticks=[], ylabel="status", xlim=(ends[0], ends[-1]), xlabel="seconds")
    axes.yaxis.label.set(rotation=0, ha="right", va="center")
    axes.grid(visible=False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    seen = [Patch(color=colour, label=name) for name, colour in STATUS.items() if np.any(status == name)]
    axes.legend(handles=seen, loc="upper left", bbox_to_anchor=(0.0, -0.9), ncols=len(STATUS))


def plot_angles(track: Track, names: tuple[str, ...]) -> Figure:
    """A figure with a plot for each angle, in degrees; right and left stand side by side, on one scale."""
    if track.angle is None or track.angle_names is None or track.angle_deviation is None:
        raise ValueError("this track has no angles")
    at = [track.angle_names.index(name) for name in names]
    value, deviation = np.degrees(track.angle[:, at]), np.degrees(track.angle_deviation[:, at])
    return plot_values(track, names, value, deviation, "{x:g}°")


def plot_slides(track: Track, slides: Slides) -> Figure:
    """The same for sliding joints, in centimetres."""
    return plot_values(track, slides.names, 100.0 * slides.value, 100.0 * slides.deviation, "{x:g} cm")


def plot_values(track: Track, names: tuple[str, ...], value: Array, deviation: Array, form: str) -> Figure:
    """A plot for each value (F, N), with one standard deviation (F, N) to either side.

    Frames in which the pose is not known are shaded. `form` is how a number is written.
    """
    sided = all(name.startswith(SIDES) for name in names)
    columns = max(1, min(2 if sided else 3, len(names)))
    rows = max(1, -(-len(names) // columns))
    low, high = value - deviation, value + deviation
    with styled():
        figure = new_figure(11.0, 1.6 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row" if sided else False)
        for n, at in enumerate(axes.ravel()[: len(names)]):
            band = {"color": HYPOTHESIS, "alpha": 0.22, "linewidth": 0, "rasterized": True}
            at.fill_between(track.time_s, low[:, n], high[:, n], **band)
            at.plot(track.time_s, value[:, n], color=REPORTED, linewidth=1.3)
            shade = {"color": STATUS["lost"], "alpha": 0.25, "linewidth": 0, "step": "mid"}
            whole = at.get_xaxis_transform()
            at.fill_between(track.time_s, 0, 1, where=track.unknown, transform=whole, **shade)
            at.set_title(plain(names)[n], fontsize=9)
            at.yaxis.set_major_formatter(form)
            at.margins(x=0)
        for at in axes.ravel()[len(names) :]:
            at.set_visible(False)
        for at in axes[-1]:
            at.set_xlabel("seconds")
    return figure


@dataclass(frozen=True, slots=True, eq=False)
class ErrorColumn:
    """Errors of one kind: their mean over all names above, and a row of colour for each name below."""

    title: str  # with the mean's value
    unit: str
    names: tuple[str, ...]  # (N,)
    errors: Array  # (F, N)
    darkest: float  # error that has the darkest colour
    least_top: float  # of the mean's axis
    best: Array | None = None  # (F, N) of the best hypothesis
    limit: float | None = None  # where errors count as large

    def draw(self, figure: Figure, above: Axes, below: Axes, time_s: Array) -> None:
        """Draw both parts."""
        mean = known_mean(self.errors, axis=1)
        if self.best is not None:
            best = known_mean(self.best, axis=1)
            label = f"best hypothesis, mean {np.nanmean(best):.1f}"
            above.plot(time_s, best, color=HYPOTHESIS, linewidth=1.3, label=label)
        label = f"reported, mean {np.nanmean(mean):.1f}"
        above.plot(time_s, mean, color=REPORTED, linewidth=1.6, label=label)
        if self.best is not None:
            above.legend(loc="upper right")
        if self.limit is not None:
            above.axhline(self.limit, color="#8a919e", linewidth=0.9, linestyle=(0, (4, 3)))
        above.set(title=self.title.format(np.nanmean(mean)), ylabel=self.unit)
        above.set_ylim(0.0, 1.1 * max(self.least_top, float(np.nanmax(mean, initial=0.0))))
        rows = np.arange(len(self.names) + 1)
        image = below.pcolormesh(
            edges(time_s), rows, self.errors.T, cmap="magma_r", vmin=0.0, vmax=self.darkest
        )
        below.set_yticks(rows[:-1] + 0.5, self.names, fontsize=8)
        below.tick_params(axis="y", length=0)
        below.invert_yaxis()
        below.grid(visible=False)
        figure.colorbar(image, ax=below, label=self.unit, extend="max", pad=0.01, fraction=0.04)


def draw_errors(track: Track, truth: Truth, file: Path) -> None:
    """Write a PNG with errors of joints, and of angles and sliding joints where they are known."""
    errors = compare(track, truth)
    columns = error_columns(errors, tuple(name for name in track.joint_names if name in truth.joint_names))
    time_s = track.time_s[np.isin(track.frame, errors.frame)]
    most = max(len(column.names) for column in columns)
    with styled():
        figure = new_figure(6.2 * len(columns) + 0.8, 4.2 + 0.22 * most)
        heights = [2.6, 0.22 * max(most, 4), 0.16]
        axes = figure.subplots(3, len(columns), sharex=True, squeeze=False, height_ratios=heights)
        for column, (above, below, strip) in zip(columns, axes.T, strict=True):
            column.draw(figure, above, below, time_s)
            draw_status(strip, track.time_s, track.status)
        figure.savefig(file)


DARKEST_ANGLE_DEG, DARKEST_SLIDE_CM = 45.0, 5.0  # errors with the darkest colour
LEAST_TOP_DEG, LEAST_TOP_SLIDE_CM = 1.0, 0.1  # so that tiny errors look tiny


def error_columns(errors: Errors, joints: tuple[str, ...]) -> list[ErrorColumn]:
    """A column for joints, angles and sliding joints each, where there are any."""
    columns = [
        ErrorColumn(
            title="joint error, mean {:.1f} cm",
            unit="cm",
            names=plain(joints),
            errors=100.0 * errors.joint_m,
            darkest=100.0 * LOST_M,
            least_top=100.0 * NEAR_M,
            limit=100.0 * NEAR_M,
        ),
        ErrorColumn(
            title="angle error",
            unit="degrees",
            names=errors.dof_names,
            errors=errors.angle_deg,
            darkest=DARKEST_ANGLE_DEG,
            least_top=LEAST_TOP_DEG,
            best=errors.best_angle_deg,
        ),
        ErrorColumn(
            title="sliding joints, mean error {:.2f} cm",
            unit="cm",
            names=plain(errors.slide_names),
            errors=100.0 * errors.slide_m,
            darkest=DARKEST_SLIDE_CM,
            least_top=LEAST_TOP_SLIDE_CM,
        ),
    ]
    return [column for column in columns if column.names]
