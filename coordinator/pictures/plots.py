"""Plots over time: their look, every angle (as a figure), and errors where the truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from coordinator.results.evaluation import NEAR_M, Errors, Truth, compare, known_mean
from coordinator.results.track import Track

REPORTED, HYPOTHESIS, TRUE = "#e8590c", "#3b82c4", "#1b1f27"
STATUS = {
    "tracked": "#5cc878",
    "ambiguous": "#f5be46",
    "lost": "#f05a5a",
    "searching": "#c86edc",
    "absent": "#969696",
}
DPI = 120

STYLE: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a919e",
    "axes.labelcolor": "#3a404c",
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e4e7ec",
    "xtick.color": "#5a616e",
    "ytick.color": "#5a616e",
    "legend.frameon": False,
    "figure.facecolor": "white",
    "svg.hashsalt": "gepf",  # equal drawings give equal text
}


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure that needs no display."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def save(figure: Figure, file: Path) -> None:
    """Write a PNG."""
    figure.savefig(file, dpi=DPI)


def styled() -> Any:
    """Context in which figures have this look."""
    return mpl.rc_context(cast("Any", STYLE))


def edges(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where each frame's share of a time axis begins, and the last one's ends (F + 1,), seconds."""
    steps = np.diff(time_s)
    half = 0.5 * float(np.median(steps)) if len(steps) else 0.5
    between = time_s[:-1] + 0.5 * steps
    return np.concatenate([[time_s[0] - half], between, [time_s[-1] + half]])


def draw_status(axes: Axes, time_s: NDArray[np.float64], status: NDArray[np.str_]) -> None:
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


COLUMNS = 3
SIDES = ("right_", "left_")


def plot_angles(track: Track, names: tuple[str, ...]) -> Figure:
    """A figure with a plot for each angle: right and left side by side, on one scale."""
    sided = all(name.startswith(SIDES) for name in names)
    columns = min(2 if sided else COLUMNS, len(names)) or 1
    rows = max(1, -(-len(names) // columns))
    with styled():
        figure = new_figure(11.0, 1.6 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row" if sided else False)
        for at, name in zip(axes.ravel(), names, strict=False):
            plot_angle(at, track, name)
        for at in axes.ravel()[len(names) :]:
            at.set_visible(False)
        for at in axes[-1]:
            at.set_xlabel("seconds")
    return figure


def plot_angle(axes: Axes, track: Track, name: str) -> None:
    """The reported value, one standard deviation to either side, and the frames in which nobody knows."""
    if track.angle is None or track.angle_names is None or track.angle_deviation is None:
        raise ValueError("this track has no angles")
    at = track.angle_names.index(name)
    value, band = np.degrees(track.angle[:, at]), np.degrees(track.angle_deviation[:, at])
    axes.fill_between(track.time_s, value - band, value + band, color=HYPOTHESIS, alpha=0.22, linewidth=0)
    axes.plot(track.time_s, value, color=REPORTED, linewidth=1.3)
    unknown = ~np.isin(track.status, ("tracked", "ambiguous"))
    axes.fill_between(
        track.time_s, 0, 1, where=unknown, step="mid", transform=axes.get_xaxis_transform(),
        color=STATUS["lost"], alpha=0.25, linewidth=0,
    )  # fmt: skip
    axes.set_title(name.replace("_", " "), fontsize=9)
    axes.margins(x=0)


COLOURS = "magma_r"
WORST_CM, WORST_DEG, WORST_SLIDE_CM = 30.0, 45.0, 5.0  # the darkest colour


def draw_errors(track: Track, truth: Truth, file: Path) -> None:
    """Write a PNG with errors of joints, and of angles and of what slides where they are known."""
    errors = compare(track, truth)
    time_s = track.time_s[np.isin(track.frame, errors.frame)]
    joints = tuple(name for name in track.joint_names if name in truth.joint_names)
    wanted = [bool(joints), bool(errors.dof_names), bool(errors.slide_names)]
    with styled():
        most = max(len(joints), len(errors.dof_names), len(errors.slide_names))
        figure, rows = new_figure(6.2 * sum(wanted) + 0.8, 4.2 + 0.22 * most), 0.22 * max(most, 4)
        axes = figure.subplots(3, sum(wanted), sharex=True, squeeze=False, height_ratios=[2.6, rows, 0.16])
        columns = iter(axes.T)
        if joints:
            draw_joint_errors(figure, next(columns), time_s, errors, joints)
        if errors.dof_names:
            draw_angle_errors(figure, next(columns), time_s, errors)
        if errors.slide_names:
            draw_slide_errors(figure, next(columns), time_s, errors)
        for strip in axes[2]:
            draw_status(strip, track.time_s, track.status)
        save(figure, file)


def draw_joint_errors(
    figure: Figure,
    axes: NDArray[np.object_],
    time_s: NDArray[np.float64],
    errors: Errors,
    joints: tuple[str, ...],
) -> None:
    """The mean joint error above, each joint's error below."""
    mean = errors.mean_joint_m * 100.0
    axes[0].plot(time_s, mean, color=REPORTED, linewidth=1.6)
    axes[0].axhline(NEAR_M * 100.0, color="#8a919e", linewidth=0.9, linestyle=(0, (4, 3)))
    axes[0].set(title=f"joint error, mean {np.nanmean(mean):.1f} cm", ylabel="centimetres")
    axes[0].set_ylim(0.0, top(mean, NEAR_M * 100.0))
    draw_rows(figure, axes[1], time_s, errors.joint_m.T * 100.0, plain(joints), WORST_CM, "cm")


def draw_angle_errors(
    figure: Figure, axes: NDArray[np.object_], time_s: NDArray[np.float64], errors: Errors
) -> None:
    """The mean angle error of the reported pose and of the best hypothesis above, each angle's below."""
    mean, best = errors.mean_angle_deg, known_mean(errors.best_angle_deg, axis=1)
    reported = f"reported, mean {np.nanmean(mean):.1f}"
    axes[0].plot(
        time_s,
        best,
        color=HYPOTHESIS,
        linewidth=1.3,
        label=f"best hypothesis, mean {np.nanmean(best):.1f}",
    )
    axes[0].plot(time_s, mean, color=REPORTED, linewidth=1.6, label=reported)
    axes[0].set(title="angle error", ylabel="degrees")
    axes[0].set_ylim(0.0, top(mean, 1.0))
    axes[0].legend(loc="upper right")
    draw_rows(figure, axes[1], time_s, errors.angle_deg.T, errors.dof_names, WORST_DEG, "degrees")


def draw_slide_errors(
    figure: Figure, axes: NDArray[np.object_], time_s: NDArray[np.float64], errors: Errors
) -> None:
    """The mean error of the joints that slide above, each one's below."""
    rows = errors.slide_m * 100.0
    mean = known_mean(rows, axis=1)
    axes[0].plot(time_s, mean, color=REPORTED, linewidth=1.6)
    axes[0].set(title=f"sliding joints, mean error {np.nanmean(mean):.2f} cm", ylabel="centimetres")
    axes[0].set_ylim(0.0, top(mean, 0.1))
    draw_rows(figure, axes[1], time_s, rows.T, plain(errors.slide_names), WORST_SLIDE_CM, "cm")


def draw_rows(
    figure: Figure,
    axes: Axes,
    time_s: NDArray[np.float64],
    rows: NDArray[np.float64],
    names: tuple[str, ...],
    worst: float,
    unit: str,
) -> None:
    """One coloured row for each name; what is not known stays white."""
    image = axes.pcolormesh(
        edges(time_s), np.arange(len(names) + 1), rows, cmap=COLOURS, vmin=0.0, vmax=worst
    )
    axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=8)
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label=unit, extend="max", pad=0.01, fraction=0.04)


def plain(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names as a person writes them."""
    return tuple(name.replace("_", " ") for name in names)


def top(values: NDArray[np.float64], least: float) -> float:
    """Upper end of an axis from zero."""
    return 1.1 * max(least, float(np.nanmax(values, initial=0.0)))
