"""Every angle over time, left beside right, with how far it may be off, as SVG to stand in a page."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coordinator.pictures.style import HYPOTHESIS, REPORTED, STATUS, new_figure, styled
from coordinator.results.track import Track

COLUMNS = 3
SIDES = ("right_", "left_")
ARM = ("clavicular", "shoulder", "elbow", "forearm", "wrist", "pinky", "ring", "middle", "index", "thumb")


def group_angles(names: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Angles by the part of the body: pelvis and trunk, arms, legs; of a robot, base and joints."""
    groups: dict[str, list[str]] = {"pelvis and trunk": [], "arms": [], "legs": [], "base and joints": []}
    person = any(name.startswith(("pelvis_", "trunk_", *SIDES)) for name in names)
    for name in sorted(names, key=lambda name: (names.index(pair_of(name, names)), name.startswith("left_"))):
        if not person:
            groups["base and joints"].append(name)
        elif name.startswith(SIDES):
            groups["arms" if any(part in name for part in ARM) else "legs"].append(name)
        else:
            groups["pelvis and trunk"].append(name)
    return [(group, members) for group, members in groups.items() if members]


def pair_of(name: str, names: tuple[str, ...]) -> str:
    """The right one of a pair of sides, the name itself where there is none: pairs stand by this."""
    right = name.replace("left_", "right_", 1)
    return right if right in names else name


def draw_angles(track: Track, names: list[str]) -> str:
    """An SVG element: a small plot for each angle, degrees over seconds."""
    buffer = io.StringIO()
    plot_angles(track, tuple(names)).savefig(buffer, format="svg", metadata={"Date": None})
    drawing = buffer.getvalue()
    return drawing[drawing.index("<svg") :]


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
