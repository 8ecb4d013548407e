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


def edges(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where each frame's share of a time axis begins, and the last one's ends (F + 1,), seconds."""
    steps = np.diff(time_s)
    half = 0.5 * float(np.median(steps)) if len(steps) else 0.5
    between = time_s[:-1] + 0.5 * steps
    return np.concatenate([[time_s[0] - half], between, [time_s[-1] + half]])


def draw_status(axes: Axes, time_s: NDArray[np.float64], status: NDArray[np.str_]) -> None:
    """Fill a strip with the colour of each frame's status, and name those that occur."""
    ends = edges(time_s)
    for name, colour in STATUS.items():
        spans = [(ends[f], ends[f + 1] - ends[f]) for f in np.flatnonzero(status == name)]
        axes.broken_barh(spans, (0, 1), color=colour, linewidth=0, antialiased=False)
    axes.set(ylim=(0, 1), yticks=[], ylabel="status", xlim=(ends[0], ends[-1]), xlabel="seconds")
    axes.yaxis.label.set(rotation=0, ha="right", va="center")
    axes.grid(visible=False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    seen = [Patch(color=colour, label=name) for name, colour in STATUS.items() if np.any(status == name)]
    axes.legend(handles=seen, loc="upper left", bbox_to_anchor=(0.0, -0.9), ncols=len(STATUS))
