"""Every angle, and what slides, over time, with how far it may be off, as drawings to stand in a page."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from coordinator.report.curve import CENTIMETRE, Curve, draw_curve
from coordinator.report.findings import SIDES, group_angles, pair_of
from coordinator.results.angles import Slides
from coordinator.results.track import Track

WIDTHS = {2: 540.0, 3: 355.0}  # of a drawing, by how many stand side by side


def draw_angles(track: Track) -> list[tuple[str, int, list[Markup]]]:
    """For each part of the body its name, how many drawings stand side by side, and the drawings."""
    return [(group, *draw_group(track, members)) for group, members in group_angles(track.angle_names or ())]


def draw_slides(track: Track, slides: Slides) -> list[tuple[str, int, list[Markup]]]:
    """The same for joints that slide, each in centimetres of its own; none where nothing does."""
    columns = 3
    curves = [slide_of(track, slides, s) for s in range(len(slides.names))]
    drawings = [draw_curve(curve, curve.reach, WIDTHS[columns]) for curve in curves]
    return [("sliding joints", columns, drawings)] if drawings else []


def draw_group(track: Track, names: list[str]) -> tuple[int, list[Markup]]:
    """Drawings of some angles; those of a pair of sides share their degrees."""
    columns = 2 if all(name.startswith(SIDES) for name in names) else 3
    curves = {name: curve_of(track, name) for name in names}
    reach: dict[str, tuple[float, float]] = {}
    for name, curve in curves.items():
        pair = pair_of(name, tuple(names))
        low, high = reach.get(pair, curve.reach)
        reach[pair] = min(low, curve.reach[0]), max(high, curve.reach[1])
    return columns, [
        draw_curve(curve, reach[pair_of(name, tuple(names))], WIDTHS[columns])
        for name, curve in curves.items()
    ]


def curve_of(track: Track, name: str) -> Curve:
    """One angle of a track, in degrees."""
    if track.angle is None or track.angle_names is None or track.angle_deviation is None:
        raise ValueError("this track has no angles")
    at = track.angle_names.index(name)
    return Curve(
        name=name.replace("_", " "),
        time_s=track.time_s,
        value=np.degrees(track.angle[:, at]),
        deviation=np.degrees(track.angle_deviation[:, at]),
        doubtful=track.unknown,
    )


def slide_of(track: Track, slides: Slides, at: int) -> Curve:
    """One sliding joint of a track, in centimetres."""
    return Curve(
        name=slides.names[at].replace("_", " ") + ", cm",
        time_s=track.time_s,
        value=100.0 * slides.value[:, at],
        deviation=100.0 * slides.deviation[:, at],
        doubtful=track.unknown,
        unit=CENTIMETRE,
    )
