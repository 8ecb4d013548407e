"""Every angle over time, with the band in which the hypotheses lie, as SVG to stand in a page."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.pictures.hypotheses import half_turn
from coordinator.pictures.style import HYPOTHESIS, REPORTED, new_figure, styled
from coordinator.results.track import Track
from coordinator.results.uncertainty import deviation

COLUMNS = 3
SIDES = {"r": "right arm and leg", "l": "left arm and leg"}


def group_angles(track: Track) -> list[tuple[str, list[str]]]:
    """Degrees of freedom by what they move: the whole, trunk and others, right, left."""
    groups: dict[str, list[str]] = {}
    for name in track.dof_names:
        side = SIDES.get(name.split("_", 1)[0], "trunk and others")
        groups.setdefault("place and direction" if name in ROOT_DOFS else side, []).append(name)
    return list(groups.items())


def draw_angles(track: Track, names: list[str]) -> str:
    """An SVG element: a small plot for each degree of freedom, degrees or metres over seconds."""
    rows = -(-len(names) // COLUMNS)
    spread = deviation(track)
    with styled():
        figure = new_figure(11.0, 1.5 * rows)
        axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for at, name in zip(axes, names, strict=False):
            draw_angle(at, track, spread, track.dof_names.index(name))
        for at in axes[len(names) :]:
            at.set_visible(False)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    drawing = buffer.getvalue()
    return drawing[drawing.index("<svg") :]


def draw_angle(axes: Axes, track: Track, spread: NDArray[np.float64], dof: int) -> None:
    """The reported value, and one standard deviation of the hypotheses to either side."""
    value, band = track.pose[:, dof], spread[:, dof]
    if track.dof_names[dof] not in ROOT_DOFS[:3]:
        value, band = np.rad2deg(np.unwrap(half_turn(value))), np.rad2deg(band)
    axes.fill_between(track.time_s, value - band, value + band, color=HYPOTHESIS, alpha=0.3, linewidth=0)
    axes.plot(track.time_s, value, color=REPORTED, linewidth=1.3)
    axes.set_title(track.dof_names[dof], fontsize=9)
    axes.margins(x=0)
