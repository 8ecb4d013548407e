"""All hypotheses over time: where the tracker was unsure, and what it chose."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.pictures.style import HYPOTHESIS, REPORTED, TRUE, draw_status, new_figure, save, styled
from coordinator.results.track import Track
from coordinator.results.truth import Truth

MOST_ANGLES = 6
OUTLIERS = 1.0  # percent of the hypotheses at either end that need not be shown


def draw_hypotheses(track: Track, truth: Truth | None, file: Path) -> None:
    """Write a PNG: the angles that vary most, the number of hypotheses, the status."""
    angles = most_varying(track)
    with styled():
        figure = new_figure(11.0, 1.7 * len(angles) + 2.3)
        heights = [*([1.7] * len(angles)), 1.2, 0.18]
        axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for at, angle in zip(axes, angles, strict=False):
            draw_angle(at, track, truth, angle)
        draw_count(axes[-2], track)
        draw_status(axes[-1], track.frame, track.status)
        axes[-1].set_xlabel("frame")
        if angles:
            axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        save(figure, file)


def most_varying(track: Track) -> list[int]:
    """Indices of the joint angles that vary most in what was reported, in the model's order."""
    joints = [j for j, name in enumerate(track.dof_names) if name not in ROOT_DOFS]
    spread = np.std(half_turn(track.pose[:, joints]), axis=0)
    chosen = np.argsort(-spread, kind="stable")[:MOST_ANGLES]
    return sorted(joints[k] for k in chosen)


def draw_angle(axes: Axes, track: Track, truth: Truth | None, angle: int) -> None:
    """Dots for hypotheses, the stronger the heavier, a line for the reported, dashes for the true value."""
    name = track.dof_names[angle]
    reported = half_turn(track.pose[:, angle])
    frames = np.broadcast_to(track.frame[:, None], track.hypothesis_weight.shape)
    values = reported[:, None] + half_turn(track.hypothesis_pose[:, :, angle] - reported[:, None])
    opacity = np.clip(0.15 + 0.85 * np.nan_to_num(track.hypothesis_weight), 0.0, 1.0)
    axes.scatter(
        frames,
        np.rad2deg(values),
        s=7,
        c=HYPOTHESIS,
        alpha=cast("Any", opacity),
        linewidths=0,
        label="hypotheses",
    )
    axes.plot(track.frame, np.rad2deg(reported), color=REPORTED, linewidth=1.6, label="reported")
    if truth is not None and name in truth.dof_names:
        true = np.rad2deg(half_turn(truth.pose[:, truth.dof_names.index(name)]))
        axes.plot(truth.frame, true, color=TRUE, linewidth=1.1, linestyle=(0, (4, 2.5)), label="truth")
    low, high = np.nanpercentile(np.rad2deg(values), [OUTLIERS, 100.0 - OUTLIERS])
    axes.set_ylim(*span(low, high, np.rad2deg(reported)))
    axes.set(title=name, ylabel="degrees", xlim=(track.frame[0] - 0.5, track.frame[-1] + 0.5))


def span(low: float, high: float, reported: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of an axis that shows from low to high and all that was reported, with some room."""
    low, high = min(low, float(np.nanmin(reported))), max(high, float(np.nanmax(reported)))
    room = max(2.0, 0.06 * (high - low))
    return low - room, high + room


def draw_count(axes: Axes, track: Track) -> None:
    """How many hypotheses each frame ended with."""
    count = np.isfinite(track.hypothesis_weight).sum(axis=1)
    axes.fill_between(track.frame, count, step="mid", color=HYPOTHESIS, alpha=0.35, linewidth=0)
    axes.set(
        title="number of hypotheses", ylim=(0, max(1.0, 1.1 * float(count.max(initial=0)))), axisbelow=True
    )
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def half_turn(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles less whole turns, from -pi to pi."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi
