"""The paper's figures 5 and 6 drawn again, and the price of an error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.paper.runs import Run
from benchmarks.paper.scores import RowScore
from coordinator.pictures.plots import new_figure, styled

COLOURS = ("#e8590c", "#3b82c4", "#2f9e44", "#9c36b5", "#1b1f27")
DEGREES = (1, 2, 5, 10, 20, 50)
CLOSE = (60, 105)  # frames around which the arm is close to the body
LABELS = {
    "r_shoulder_flexion": "shoulder flexion",
    "r_shoulder_abduct": "shoulder abduction",
    "r_shoulder_twisting": "shoulder twisting",
    "r_elbow_flexion": "elbow flexion",
}
PANELS = (
    ("gradient-paper", "gradient, preset paper"),
    ("gradient-default", "gradient, preset default"),
    ("gepf-20-paper", "20 particles, preset paper: best hypothesis"),
    ("gepf-20-default", "20 particles, preset default: best hypothesis"),
)


def draw(runs: Mapping[str, Sequence[Run]], rows: Sequence[RowScore], folder: Path) -> list[Path]:
    """Draw every picture whose rows are there; gives the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    with styled():
        if {name for name, _ in PANELS} <= runs.keys():
            files.append(folder / "paper-noise.png")
            draw_noise(runs, files[-1])
        if {"clean-gradient-paper", "clean-gradient-default"} <= runs.keys():
            files.append(folder / "paper-clean.png")
            draw_clean(runs, files[-1])
        if any(row.part == "curves" for row in rows):
            files.append(folder / "paper-curves.png")
            draw_curves([row for row in rows if row.part == "curves"], files[-1])
    return files


def draw_noise(runs: Mapping[str, Sequence[Run]], file: Path) -> None:
    """As the paper's Fig. 5: each angle's error of the best hypothesis, one seed; and the gradient's."""
    figure = new_figure(8.5, 9.4)
    panels = figure.subplots(len(PANELS), 1, sharex=True, sharey=True)
    for axes, (name, title) in zip(panels, PANELS, strict=True):
        run = runs[name][0]
        errors = np.array(run.best_deg)
        for a, angle in enumerate(run.angles):
            axes.plot(errors[:, a], color=COLOURS[a], linewidth=1.1, label=LABELS.get(angle, angle))
        axes.set(title=f"{title}, mean {errors.mean():.1f} degrees", ylabel="degrees", ylim=(0.0, 100.0))
        mark_close(axes)
    panels[-1].legend(loc="upper right", ncols=4, fontsize=8)
    panels[-1].set_xlabel("frame (shaded: the arm is close to the body)")
    figure.savefig(file)


def draw_clean(runs: Mapping[str, Sequence[Run]], file: Path) -> None:
    """As the paper's Fig. 6: the abduction angle's error without noise."""
    figure = new_figure(8.5, 2.8)
    axes = figure.subplots()
    for colour, preset in zip(COLOURS, ("paper", "default"), strict=False):
        run = runs[f"clean-gradient-{preset}"][0]
        error = np.array(run.reported_deg)[:, run.angles.index("r_shoulder_abduct")]
        axes.plot(
            error,
            color=colour,
            linewidth=1.2,
            label=f"preset {preset}, mean {error[10:].mean():.2f} after frame 10",
        )
    axes.set(
        title="gradient tracking without noise: shoulder abduction",
        ylabel="degrees",
        xlabel="frame",
        ylim=(0.0, 2.0),
    )
    mark_close(axes)
    axes.legend(loc="upper right")
    figure.savefig(file)


def mark_close(axes: Axes) -> None:
    """Shade the frames around which the arm is close to the body."""
    for frame in CLOSE:
        axes.axvspan(frame - 6, frame + 6, color="#eef0f4", zorder=0)


def draw_curves(rows: Sequence[RowScore], file: Path) -> None:
    """Error against evaluations a frame, and against processor time a frame."""
    figure = new_figure(8.5, 3.8)
    left, right = figure.subplots(1, 2, sharey=True)
    for colour, kind in zip(COLOURS, dict.fromkeys(kind_of(row) for row in rows), strict=False):
        of_kind = [row for row in rows if kind_of(row) == kind]
        errors = [row.reported_deg for row in of_kind]
        for axes, cost in (
            (left, [row.evaluations for row in of_kind]),
            (right, [row.ms_per_frame for row in of_kind]),
        ):
            axes.loglog(cost, errors, "o-", color=colour, markersize=4, linewidth=1.3, label=kind)
    left.set_yticks(DEGREES, map(str, DEGREES))
    left.minorticks_off()
    left.set(title="reported pose", xlabel="likelihood evaluations a frame", ylabel="mean error, degrees")
    right.set(xlabel="processor time a frame, ms")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    figure.savefig(file)


def kind_of(row: RowScore) -> str:
    """Method and preset."""
    return f"{row.settings.method}, {row.settings.preset}"
