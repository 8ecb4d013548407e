"""Accuracy over the number of particles, one line a frame rate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.frame_rates.rows import ROWS
from benchmarks.frame_rates.scores import RowScore
from coordinator.pictures.plots import new_figure, styled

COLOURS = {30.0: "#1b1f27", 15.0: "#2f9e44", 10.0: "#3b82c4", 6.0: "#e8590c"}  # by frames a second


def draw(scores: Sequence[RowScore], file: Path) -> None:
    """Draw uncontradicted joints within 10 cm, offsets removed, into a PNG; other rows are left out."""
    with styled():
        figure = new_figure(6.0, 3.4)
        axes = figure.subplots()
        for rate in sorted({score.frames_per_second for score in scores}, reverse=True):
            points = points_at(rate, scores)
            if points:
                axes.semilogx(*zip(*points, strict=True), "o-", color=COLOURS.get(rate), label=f"{rate:g}")
        axes.set_xticks([1, 20, 100], ["1", "20", "100"], minor=False)
        axes.set_xticks([], minor=True)
        axes.set_xlabel("particles")
        axes.set_ylabel("joints within 10 cm, %")
        axes.legend(title="frames a second")
        figure.savefig(file)


def points_at(rate: float, scores: Sequence[RowScore]) -> list[tuple[int, float]]:
    """Numbers of particles, ascending, and per cent of joints at a frame rate."""
    particles = {row.name: row.particles for row in ROWS if row.particles is not None and not row.changes}
    return sorted(
        (particles[score.row], score.uncontradicted.offset_removed_percent)
        for score in scores
        if score.frames_per_second == rate and score.row in particles
    )
