"""All hypotheses over time: where the tracker was unsure, and what it chose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.bodies.angles import angles_of
from coordinator.pictures.plots import (
    HYPOTHESIS,
    REPORTED,
    TRUE,
    draw_status,
    edges,
    new_figure,
    styled,
)
from coordinator.results.angles import ensure_angles, hypotheses_near, slides_of
from coordinator.results.evaluation import Truth
from coordinator.results.track import Track, TrackedBody

Array = NDArray[np.float64]

MOST_ANGLES, MOST_SLIDES = 6, 3


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """What one plot shows over F frames: an angle in degrees, or a sliding joint in centimetres."""

    name: str
    unit: str
    reported: Array  # (F,)
    hypotheses: Array  # (F, M)
    true: Array  # (F,) NaN where it is not known


def draw_hypotheses(track: Track, body: TrackedBody, truth: Truth | None, file: Path) -> None:
    """Write a PNG: the angles and sliding joints that vary most, the number of hypotheses, the status."""
    curves = curves_of(track, body, truth)
    with styled():
        figure = new_figure(11.0, 1.7 * len(curves) + 2.3)
        heights = [*([1.7] * len(curves)), 1.2, 0.18]
        axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for at, curve in zip(axes, curves, strict=False):
            draw_curve(at, track, curve)
        draw_count(axes[-2], track)
        draw_status(axes[-1], track.time_s, track.status)
        if curves:
            axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        figure.savefig(file)


def curves_of(track: Track, body: TrackedBody, truth: Truth | None) -> list[Curve]:
    """The angles and the sliding joints that vary most, in the body's order; not the whole body's turn.

    The truth is shown where it has all degrees of freedom of the track.
    """
    angles = angles_of(body.model, body.held, track.up)
    reported = ensure_angles(track, angles).angle
    assert reported is not None
    true_pose = true_poses(track, truth)
    true, known = np.full(reported.shape, np.nan), np.isfinite(true_pose).all(axis=1)
    if known.any():
        true[known] = angles.near(angles.measure(true_pose[known]), reported[known])
    others = hypotheses_near(track, angles, reported)
    first = 3 if angles.spherical and angles.spherical[0].dofs[0].name in ROOT_DOFS else 0
    curves = []
    for a in widest(reported[:, first:], MOST_ANGLES):
        values = (np.degrees(each[..., first + a]) for each in (reported, others, true))
        curves.append(Curve(angles.names[first + a], "degrees", *values))
    slides = slides_of(track, body.model)
    for s in widest(slides.value, MOST_SLIDES):
        at = track.dof_names.index(slides.names[s])
        values = (100.0 * each[..., at] for each in (track.pose, track.hypothesis_pose, true_pose))
        curves.append(Curve(slides.names[s], "cm", *values))
    return curves


def widest(values: Array, most: int) -> list[int]:
    """Which columns of (F, N) vary most, in their order; at most `most`."""
    spread = np.nanstd(values, axis=0)
    return sorted(int(k) for k in np.argsort(-spread, kind="stable")[:most])


def true_poses(track: Track, truth: Truth | None) -> Array:
    """True poses (F, D) of the track's frames; NaN where they are not known."""
    poses = np.full(track.pose.shape, np.nan)
    if truth is not None and set(track.dof_names) <= set(truth.dof_names):
        _, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
        poses[mine] = truth.pose[theirs][:, [truth.dof_names.index(name) for name in track.dof_names]]
    return poses


def draw_curve(axes: Axes, track: Track, curve: Curve) -> None:
    """Dots for hypotheses, the likely ones more opaque, a line for what is reported, dashes for the truth."""
    times = np.broadcast_to(track.time_s[:, None], track.hypothesis_weight.shape)
    opacity = cast("Any", np.clip(0.15 + 0.85 * np.nan_to_num(track.hypothesis_weight), 0.0, 1.0))
    dots = {"s": 7, "c": HYPOTHESIS, "alpha": opacity, "linewidths": 0}
    axes.scatter(times, curve.hypotheses, label="hypotheses", **dots)
    axes.plot(track.time_s, curve.reported, color=REPORTED, linewidth=1.6, label="reported")
    shown = np.column_stack([curve.hypotheses, curve.reported])
    low, high = np.nanpercentile(shown, [1.0, 99.0])  # a few outliers need not be shown
    low, high = min(low, float(np.nanmin(curve.reported))), max(high, float(np.nanmax(curve.reported)))
    margin = max(2.0, 0.06 * (high - low))
    axes.set_ylim(low - margin, high + margin)
    axes.set(title=curve.name.replace("_", " "), ylabel=curve.unit)
    if np.isfinite(curve.true).any():
        axes.plot(track.time_s, curve.true, color=TRUE, linewidth=1.1, linestyle=(0, (4, 2.5)), label="truth")


def draw_count(axes: Axes, track: Track) -> None:
    """How many hypotheses each frame ended with."""
    count = np.isfinite(track.hypothesis_weight).sum(axis=1)
    axes.stairs(count, edges(track.time_s), fill=True, color=HYPOTHESIS, alpha=0.35)
    highest = max(1.0, 1.1 * float(count.max(initial=0)))
    axes.set(title="number of hypotheses", ylim=(0, highest), axisbelow=True)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
