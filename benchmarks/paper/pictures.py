"""The paper's figure 5, and accuracy over cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.paper.runs import Run
from benchmarks.paper.scores import RowScore
from gepf.coordinator.pictures.plots import styled

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


def draw(runs: Mapping[str, Run | None], rows: Sequence[RowScore], folder: Path) -> list[Path]:
    """Draw every picture for which there are rows; returns the files. `runs` are those of the first seed."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    panels = [(run, title) for name, title in PANELS if (run := runs.get(name)) is not None]
    curves = [row for row in rows if row.row.part == "curves"]
    with styled():
        if len(panels) == len(PANELS):
            files.append(folder / "paper-noise.png")
            draw_noise(panels, files[-1])
        if curves:
            files.append(folder / "paper-curves.png")
            draw_curves(curves, files[-1])
    return files


def draw_noise(panels: Sequence[tuple[Run, str]], file: Path) -> None:
    """As the paper's Fig. 5: errors of each angle, best hypothesis and gradient, one seed."""
    figure = Figure(figsize=(8.5, 9.4), layout="constrained")
    axes_of = figure.subplots(len(panels), 1, sharex=True, sharey=True)
    for axes, (run, title) in zip(axes_of, panels, strict=True):
        for a, angle in enumerate(run.angles):
            axes.plot(run.best_deg[:, a], color=COLOURS[a], linewidth=1.1, label=LABELS.get(angle, angle))
        axes.set(
            title=f"{title}, mean {run.best_deg.mean():.1f} degrees", ylabel="degrees", ylim=(0.0, 100.0)
        )
        for frame in CLOSE:
            axes.axvspan(frame - 6, frame + 6, color="#eef0f4", zorder=0)
    axes_of[-1].legend(loc="upper right", ncols=4, fontsize=8)
    axes_of[-1].set_xlabel("frame (shaded: the arm is close to the body)")
    figure.savefig(file)


def draw_curves(rows: Sequence[RowScore], file: Path) -> None:
    """Error over evaluations per frame, and over processor time per frame."""
    figure = Figure(figsize=(8.5, 3.8), layout="constrained")
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
    return f"{row.row.method}, {row.row.preset}"
