"""Plots over time: angles, prismatic joints, their hypotheses, and the truth if it is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, TRANSLATION
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.palette import CURVES, STATUS
from gepf.coordinator.results.angles import measure, near_to
from gepf.coordinator.results.evaluation import Truth
from gepf.coordinator.results.track import Track, TrackedBody, filled

SIDES = ("right_", "left_")

STYLE: Mapping[str, Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "figure.figsize": (11.0, 1.7),  # inches; a row of plots
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "gepf",  # equal drawings give equal text
}


def styled() -> Any:
    """Context in which figures are drawn and saved in this style."""
    return mpl.rc_context(cast("Any", STYLE))


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The data of one plot over F frames: an angle in degrees, or a prismatic joint in centimetres."""

    name: str
    unit: str  # as it follows a number
    reported: Array  # (F,)
    deviation: Array | None = None  # (F,) one standard deviation
    hypotheses: Array | None = None  # (F, M)
    true: Array | None = None  # (F,) NaN if unknown

    def draw(self, axes: Axes, track: Track) -> None:
        """Draw a line, a band for the deviation, dots for hypotheses, dashes for the truth."""
        time_s = track.time_s
        if self.deviation is not None:
            low, high = self.reported - self.deviation, self.reported + self.deviation
            axes.fill_between(time_s, low, high, color=CURVES.hypothesis, alpha=CURVES.faint, linewidth=0)
        if self.hypotheses is not None:
            times = np.broadcast_to(time_s[:, None], self.hypotheses.shape)
            opacity = cast("Any", np.sqrt(np.nan_to_num(track.hypothesis_weight)))
            axes.scatter(times, self.hypotheses, s=8, c=CURVES.hypothesis, alpha=opacity)
            axes.scatter([], [], s=8, c=CURVES.hypothesis, label="hypotheses")  # the legend's is opaque
        axes.plot(time_s, self.reported, color=CURVES.reported, label="reported")
        if self.true is not None and np.isfinite(self.true).any():
            axes.plot(time_s, self.true, "--", color=CURVES.true, label="truth")
        half = 0.5 * float(np.median(np.diff(track.time_s))) if len(track.time_s) > 1 else 0.5
        for status, first, last in track.stretches():
            if status != "tracked":
                ends = track.time_s[first] - half, track.time_s[last] + half
                axes.axvspan(*ends, color=STATUS[status], alpha=CURVES.faint, linewidth=0)
        axes.set(title=self.name.replace("_", " "))
        axes.yaxis.set_major_formatter(f"{{x:g}}{self.unit}")
        axes.margins(x=0)


def angle_curves(track: Track, names: Iterable[str]) -> list[Curve]:
    """Angles of a track with their deviations."""
    at = {name: track.angle_names.index(name) for name in names}
    value, deviation = np.degrees(track.angle), np.degrees(track.angle_deviation)
    return [Curve(name, "°", value[:, a], deviation[:, a]) for name, a in at.items()]


def plot_curves(track: Track, curves: Sequence[Curve], columns: int | None = None) -> Figure:
    """A figure with one plot per curve; right and left are side by side with one scale."""
    paired = columns is None and all(curve.name.startswith(SIDES) for curve in curves)
    columns = max(1, min(columns or (2 if paired else 3), len(curves)))
    rows = max(1, -(-len(curves) // columns))
    with styled():
        figure = Figure()
        figure.set_figheight(rows * figure.get_figheight())
        # neither a layout engine nor sharex: they are slow for as many plots as a person has angles
        sharey: Literal["row", "none"] = "row" if paired else "none"
        place = grid(rows, columns, *figure.get_size_inches())
        axes = figure.subplots(rows, columns, squeeze=False, sharey=sharey, gridspec_kw=place)
        for at, curve in zip_longest(axes.ravel(), curves):
            if curve is None:
                at.set_axis_off()
            else:
                curve.draw(at, track)
        shown = axes.ravel()[: len(curves)]
        starts, ends = zip(*(at.get_xlim() for at in shown), strict=True) if len(shown) else ((0.0,), (1.0,))
        for at in shown:
            at.set_xlim(min(starts), max(ends))
        for at in axes[:-1].ravel():
            at.tick_params(labelbottom=False)
        for at in axes[-1]:
            at.set_xlabel("seconds")
    return figure


def grid(rows: int, columns: int, width: float, height: float) -> dict[str, float]:
    """Places of the plots in a figure with this size in inches, with room for titles and tick labels."""
    left, right, top, bottom, between_columns, between_rows = 0.75, 0.15, 0.35, 0.5, 0.65, 0.5
    plot_width = (width - left - right - (columns - 1) * between_columns) / columns
    plot_height = (height - top - bottom - (rows - 1) * between_rows) / rows
    return {
        "left": left / width,
        "right": 1.0 - right / width,
        "top": 1.0 - top / height,
        "bottom": bottom / height,
        "wspace": between_columns / plot_width,
        "hspace": between_rows / plot_height,
    }


def draw_hypotheses(track: Track, body: TrackedBody, truth: Truth | None, file: Path) -> None:
    """Write a PNG: the angles that vary most and the prismatic joints, with all hypotheses."""
    placed, track = track.placed, filled(track)
    curves = curves_of(track, body, truth)
    for curve in curves:
        curve.reported[~placed] = np.nan  # before the first detection
    figure = plot_curves(track, curves, 1)
    handles = [*figure.axes[0].get_legend_handles_labels()[0]]
    seen = set(track.status.tolist()) - {"tracked"}
    handles += [Patch(color=STATUS[name], alpha=CURVES.faint, label=name) for name in STATUS if name in seen]
    figure.legend(handles=handles, loc="upper right", ncols=len(handles), frameon=False)
    with styled():
        figure.savefig(file)


def curves_of(track: Track, body: TrackedBody, truth: Truth | None) -> list[Curve]:
    """The angles that vary most, in the body's order and without the root; the prismatic joints.

    The truth is shown if it has all degrees of freedom of the track.
    """
    angles = angles_of(body.model, body.held, track.up)
    reported, true_pose = track.angle, np.full(track.pose.shape, np.nan)
    if truth is not None and set(track.dof_names) <= set(truth.dof_names):
        _, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
        true_pose[mine] = truth.pose[theirs][:, [truth.dof_names.index(name) for name in track.dof_names]]
    true, known = np.full(reported.shape, np.nan), np.isfinite(true_pose).all(axis=1)
    if known.any():
        true[known] = angles.near(angles.measure(true_pose[known]), reported[known])
    others = near_to(reported, measure(track, angles)[1], angles)
    others[np.isnan(track.hypothesis_weight)] = np.nan
    first = 3 if angles.spherical and angles.spherical[0].dofs[0].name in ROOT_DOFS else 0
    curves = []
    for a in sorted(first + np.argsort(-np.nanstd(reported[:, first:], axis=0), kind="stable")[:6]):
        line, dots, dashes = (np.degrees(each[..., a]) for each in (reported, others, true))
        curves.append(Curve(angles.names[a], "°", line, hypotheses=dots, true=dashes))
    for name in body.model.joints_of(TRANSLATION):
        at = track.dof_names.index(name)
        line, dots, dashes = (
            100.0 * each[..., at] for each in (track.pose, track.hypothesis_pose, true_pose)
        )
        curves.append(Curve(name, " cm", line, hypotheses=dots, true=dashes))
    return curves
