"""The colours of pictures, plots, exported bodies and markers."""

from __future__ import annotations

import msgspec

Colour = tuple[int, int, int]
"""RGB, from 0 to 255."""


class Palette(msgspec.Struct, frozen=True):
    """Colours of pictures, and of bodies in other programs."""

    background: Colour = (19, 23, 31)  #: also of pixels without depth, and around letters
    depth: Colour = (225, 230, 238)
    body: Colour = (255, 122, 28)
    skeleton: Colour = (255, 255, 255)  #: of the reported pose; also of letters
    hypotheses: Colour = (92, 214, 255)  #: skeletons of all hypotheses
    floor: Colour = (70, 150, 90)
    wall: Colour = (80, 110, 170)
    candidates: tuple[Colour, ...] = ((255, 200, 60), (255, 120, 60), (200, 90, 200))  #: the best first

    exported_body: tuple[float, float, float] = (0.8, 0.45, 0.2)  #: RGB, from 0 to 1
    doubtful_joint: tuple[float, float, float] = (1.0, 0.1, 0.1)  #: the same


class CurveColours(msgspec.Struct, frozen=True):
    """Colours of plots."""

    reported: str = "#e8590c"
    hypothesis: str = "#3b82c4"  #: also of the band of deviations
    true: str = "#1b1f27"
    faint: float = 0.25  #: opacity of what is behind a curve


PALETTE = Palette()
CURVES = CurveColours()
STATUS = {
    "tracked": "#5cc878",
    "ambiguous": "#f5be46",
    "lost": "#f05a5a",
    "searching": "#c86edc",
    "absent": "#969696",
}
"""Colours of the status of a body."""
