"""Every angle over time, left beside right, with how far it may be off, as a figure."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coordinator.pictures.style import HYPOTHESIS, REPORTED, STATUS, new_figure, styled
from coordinator.results.track import Track

COLUMNS = 3
SIDES = ("right_", "left_")


def plot_angles(track: Track, names: tuple[str, ...]) -> Figure:
    """A figure with a plot for each angle: right and left side by side, on one scale."""
    sided = all(name.startswith(SIDES) for name in names)
    columns = min(2 if sided else COLUMNS, len(names)) or 1
    rows = max(1, -(-len(names) // columns))
    with styled():
        figure = new_figure(11.0, 1.6 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row" if sided else False)
        for at, name in zip(axes.ravel(), names, strict=False):
            plot_angle(at, track, name)
        for at in axes.ravel()[len(names) :]:
            at.set_visible(False)
        for at in axes[-1]:
            at.set_xlabel("seconds")
    return figure


def plot_angle(axes: Axes, track: Track, name: str) -> None:
    """The reported value, one standard deviation to either side, and the frames in which nobody knows."""
    if track.angle is None or track.angle_names is None or track.angle_deviation is None:
        raise ValueError("this track has no angles")
    at = track.angle_names.index(name)
    value, band = np.degrees(track.angle[:, at]), np.degrees(track.angle_deviation[:, at])
    axes.fill_between(track.time_s, value - band, value + band, color=HYPOTHESIS, alpha=0.22, linewidth=0)
    axes.plot(track.time_s, value, color=REPORTED, linewidth=1.3)
    unknown = ~np.isin(track.status, ("tracked", "ambiguous"))
    axes.fill_between(
        track.time_s, 0, 1, where=unknown, step="mid", transform=axes.get_xaxis_transform(),
        color=STATUS["lost"], alpha=0.25, linewidth=0,
    )  # fmt: skip
    axes.set_title(name.replace("_", " "), fontsize=9)
    axes.margins(x=0)
