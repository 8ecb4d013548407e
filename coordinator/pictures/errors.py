"""Errors over time where the truth is known: means as curves, each joint and angle as a row of colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from coordinator.pictures.style import HYPOTHESIS, REPORTED, draw_status, edges, new_figure, save, styled
from coordinator.results.evaluation import NEAR_M, Errors, compare, known_mean
from coordinator.results.track import Track
from coordinator.results.truth import Truth

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
