"""The look that all plots share."""

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


def draw_status(axes: Axes, frame: NDArray[np.int64], status: NDArray[np.str_]) -> None:
    """Fill a strip with the colour of each frame's status, and name those that occur."""
    for name, colour in STATUS.items():
        axes.fill_between(frame, 0, 1, where=status == name, step="mid", color=colour, linewidth=0)
    axes.set(ylim=(0, 1), yticks=[], ylabel="status")
    axes.yaxis.label.set(rotation=0, ha="right", va="center")
    axes.grid(visible=False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    seen = [Patch(color=colour, label=name) for name, colour in STATUS.items() if np.any(status == name)]
    axes.legend(handles=seen, loc="upper left", bbox_to_anchor=(0.0, -0.9), ncols=len(STATUS))
