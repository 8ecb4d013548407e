"""All hypotheses over time: where the tracker was unsure, and what it chose."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.bodies.angles import Angles, angles_of
from coordinator.pictures.style import (
    HYPOTHESIS,
    REPORTED,
    TRUE,
    draw_status,
    edges,
    new_figure,
    save,
    styled,
)
from coordinator.results.model_file import TrackedBody
from coordinator.results.track import Track
from coordinator.results.truth import Truth
from coordinator.results.uncertainty import hypotheses_near, with_angles

Array = NDArray[np.float64]

MOST_ANGLES = 6
OUTLIERS = 1.0  # percent of the hypotheses at either end that need not be shown


def draw_hypotheses(track: Track, body: TrackedBody, truth: Truth | None, file: Path) -> None:
    """Write a PNG: the angles that vary most, the number of hypotheses, the status."""
    angles = angles_of(body.model, body.held, track.up)
    reported = reported_angles(track, angles)
    others = np.degrees(hypotheses_near(track, angles, reported))
    chosen = most_varying(angles, reported)
    with styled():
        figure = new_figure(11.0, 1.7 * len(chosen) + 2.3)
        heights = [*([1.7] * len(chosen)), 1.2, 0.18]
        axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for at, a in zip(axes, chosen, strict=False):
            draw_angle(at, track, np.degrees(reported[:, a]), others[:, :, a])
            at.set_title(angles.names[a].replace("_", " "))
        if truth is not None and set(track.dof_names) <= set(truth.dof_names):
            draw_truth(axes, track, true_angles(track, truth, angles, reported)[:, chosen])
        draw_count(axes[-2], track)
        draw_status(axes[-1], track.time_s, track.status)
        if chosen:
            axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        save(figure, file)


def reported_angles(track: Track, angles: Angles) -> Array:
    """The angles (F, A) that the track says, radians; of one without angles those of its poses."""
    known = track if track.angle is not None else with_angles(track, angles)
    assert known.angle is not None
    return known.angle


def most_varying(angles: Angles, reported: Array) -> list[int]:
    """Which reported angles (F, A) vary most, in the body's order; not the whole body's turn."""
    first = 3 if angles.balls and angles.balls[0].dofs[0].name in ROOT_DOFS else 0
    spread = np.nanstd(reported[:, first:], axis=0)
    return sorted(int(first + k) for k in np.argsort(-spread, kind="stable")[:MOST_ANGLES])


def draw_angle(axes: Axes, track: Track, reported: Array, others: Array) -> None:
    """Dots for hypotheses (F, M), the stronger the heavier, a line for the reported (F,); degrees."""
    times = np.broadcast_to(track.time_s[:, None], track.hypothesis_weight.shape)
    opacity = np.clip(0.15 + 0.85 * np.nan_to_num(track.hypothesis_weight), 0.0, 1.0)
    axes.scatter(
        times, others, s=7, c=HYPOTHESIS, alpha=cast("Any", opacity), linewidths=0, label="hypotheses"
    )
    axes.plot(track.time_s, reported, color=REPORTED, linewidth=1.6, label="reported")
    low, high = np.nanpercentile(np.column_stack([others, reported]), [OUTLIERS, 100.0 - OUTLIERS])
    axes.set_ylim(*span(low, high, reported))
    axes.set_ylabel("degrees")


def true_angles(track: Track, truth: Truth, angles: Angles, reported: Array) -> Array:
    """True angles (F, A) of the track's frames, each on the reported one's turn; NaN where nobody knows."""
    _, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
    columns = [truth.dof_names.index(name) for name in track.dof_names]
    poses = truth.pose[theirs][:, columns]
    known = np.isfinite(poses).all(axis=1)
    true = np.full(reported.shape, np.nan)
    true[mine[known]] = angles.near(angles.measure(poses[known]), reported[mine[known]])
    return true


def draw_truth(axes: NDArray[np.object_], track: Track, true: Array) -> None:
    """Dashes for the true angles (F, K)."""
    for at, values in zip(axes, np.degrees(true).T, strict=False):
        at.plot(track.time_s, values, color=TRUE, linewidth=1.1, linestyle=(0, (4, 2.5)), label="truth")


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
