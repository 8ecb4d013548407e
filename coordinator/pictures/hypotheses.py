"""All hypotheses over time: where the tracker was unsure, and what it chose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from coordinator.bodies.angles import Angles, angles_of
from coordinator.pictures.plots import (
    HYPOTHESIS,
    REPORTED,
    TRUE,
    draw_status,
    edges,
    new_figure,
    save,
    styled,
)
from coordinator.results.angles import hypotheses_near, saying, slides_of
from coordinator.results.evaluation import Truth
from coordinator.results.track import Track, TrackedBody

Array = NDArray[np.float64]

MOST_ANGLES, MOST_SLIDES = 6, 3
OUTLIERS = 1.0  # percent of the hypotheses at either end that need not be shown


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """What one drawing shows over F frames: an angle in degrees, or what slides in centimetres."""

    title: str
    unit: str
    reported: Array  # (F,)
    hypotheses: Array  # (F, M)
    true: Array  # (F,) NaN where nobody knows


def draw_hypotheses(track: Track, body: TrackedBody, truth: Truth | None, file: Path) -> None:
    """Write a PNG: angles and what slides, those that vary most, the number of hypotheses, the status."""
    known = truth if truth is not None and set(track.dof_names) <= set(truth.dof_names) else None
    angles = angles_of(body.model, body.held, track.up)
    curves = [*curves_of_angles(track, angles, known), *curves_of_slides(track, body.model, known)]
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
        save(figure, file)


def curves_of_angles(track: Track, angles: Angles, truth: Truth | None) -> list[Curve]:
    """The angles that vary most."""
    reported = reported_angles(track, angles)
    others = hypotheses_near(track, angles, reported)
    true = np.full(reported.shape, np.nan)
    if truth is not None:
        true = true_angles(track, truth, angles, reported)
    return [
        Curve(
            angles.names[a].replace("_", " "),
            "degrees",
            np.degrees(reported[:, a]),
            np.degrees(others[:, :, a]),
            np.degrees(true[:, a]),
        )
        for a in most_varying(angles, reported)
    ]


def curves_of_slides(track: Track, model: BodyModel, truth: Truth | None) -> list[Curve]:
    """The joints that vary most of those that slide."""
    slides = slides_of(track, model)
    at = [track.dof_names.index(name) for name in slides.names]
    true = (
        true_poses(track, truth)[:, at] if truth is not None else np.full((len(track.frame), len(at)), np.nan)
    )
    return [
        Curve(
            slides.names[s].replace("_", " "),
            "cm",
            100.0 * slides.value[:, s],
            100.0 * track.hypothesis_pose[:, :, at[s]],
            100.0 * true[:, s],
        )
        for s in widest(slides.value, MOST_SLIDES)
    ]


def reported_angles(track: Track, angles: Angles) -> Array:
    """The angles (F, A) that the track says, radians; of one without angles those of its poses."""
    known = saying(track, angles)
    assert known.angle is not None
    return known.angle


def most_varying(angles: Angles, reported: Array) -> list[int]:
    """Which reported angles (F, A) vary most, in the body's order; not the whole body's turn."""
    first = 3 if angles.balls and angles.balls[0].dofs[0].name in ROOT_DOFS else 0
    return [first + k for k in widest(reported[:, first:], MOST_ANGLES)]


def widest(values: Array, most: int) -> list[int]:
    """Which columns of (F, N) vary most, in their order; at most so many."""
    spread = np.nanstd(values, axis=0)
    return sorted(int(k) for k in np.argsort(-spread, kind="stable")[:most])


def draw_curve(axes: Axes, track: Track, curve: Curve) -> None:
    """Dots for hypotheses, the stronger the heavier, a line for what is reported, dashes for the truth."""
    times = np.broadcast_to(track.time_s[:, None], track.hypothesis_weight.shape)
    opacity = np.clip(0.15 + 0.85 * np.nan_to_num(track.hypothesis_weight), 0.0, 1.0)
    axes.scatter(
        times,
        curve.hypotheses,
        s=7,
        c=HYPOTHESIS,
        alpha=cast("Any", opacity),
        linewidths=0,
        label="hypotheses",
    )
    axes.plot(track.time_s, curve.reported, color=REPORTED, linewidth=1.6, label="reported")
    shown = np.column_stack([curve.hypotheses, curve.reported])
    low, high = np.nanpercentile(shown, [OUTLIERS, 100.0 - OUTLIERS])
    axes.set_ylim(*span(low, high, curve.reported))
    axes.set(title=curve.title, ylabel=curve.unit)
    if np.isfinite(curve.true).any():
        axes.plot(track.time_s, curve.true, color=TRUE, linewidth=1.1, linestyle=(0, (4, 2.5)), label="truth")


def true_angles(track: Track, truth: Truth, angles: Angles, reported: Array) -> Array:
    """True angles (F, A) of the track's frames, each on the reported one's turn; NaN where nobody knows."""
    poses = true_poses(track, truth)
    known = np.isfinite(poses).all(axis=1)
    true = np.full(reported.shape, np.nan)
    true[known] = angles.near(angles.measure(poses[known]), reported[known])
    return true


def true_poses(track: Track, truth: Truth) -> Array:
    """True poses (F, D) of the track's frames; NaN where nobody knows."""
    _, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
    columns = [truth.dof_names.index(name) for name in track.dof_names]
    poses = np.full(track.pose.shape, np.nan)
    poses[mine] = truth.pose[theirs][:, columns]
    return poses


def span(low: float, high: float, reported: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of an axis that shows from low to high and all that was reported, with some room."""
    low, high = min(low, float(np.nanmin(reported))), max(high, float(np.nanmax(reported)))
    room = max(2.0, 0.06 * (high - low))
    return low - room, high + room


def draw_count(axes: Axes, track: Track) -> None:
    """How many hypotheses each frame ended with."""
    count = np.isfinite(track.hypothesis_weight).sum(axis=1)
    axes.stairs(count, edges(track.time_s), fill=True, color=HYPOTHESIS, alpha=0.35)
    axes.set(
        title="number of hypotheses", ylim=(0, max(1.0, 1.1 * float(count.max(initial=0)))), axisbelow=True
    )
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
