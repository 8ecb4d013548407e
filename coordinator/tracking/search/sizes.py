"""The sizes that a body is sought in: people's stature and girth, or none for a body that is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

STATURES = (1.5, 1.62, 1.74, 1.86, 1.98)  # metres
GIRTH = 1.05  # of all of them
SCALES = (0.94, 0.97, 1.0, 1.03, 1.06)
GIRTHS = (0.9, 1.05, 1.2)
SHORTEST, TALLEST = STATURES[0] * SCALES[0], STATURES[-1] * SCALES[-1]


class Size(NamedTuple):
    """Stature in metres, and girth as a factor; not a number for a body without them."""

    stature: float
    girth: float

    @property
    def extreme(self) -> bool:
        """Whether it is the smallest or largest that is sought: whoever it is may be smaller or larger."""
        return self.stature < SHORTEST * 1.01 or self.stature > TALLEST * 0.99


ANY = tuple(Size(stature, GIRTH) for stature in STATURES)


def taller_and_shorter(size: Size) -> list[Size]:
    """Sizes near one."""
    return [Size(size.stature * scale, size.girth) for scale in SCALES]


def thinner_and_thicker(size: Size) -> list[Size]:
    """The same stature with every girth."""
    return [Size(size.stature, girth) for girth in GIRTHS]


def vary(tried: Sequence[Sequence[Size]]) -> tuple[list[Size], NDArray[np.int64], NDArray[np.int64]]:
    """All different sizes of what is tried with each of several candidates.

    With them, for each combination of candidate and size: the place of its size, and its candidate.
    """
    places: dict[Size, int] = {}
    place = [places.setdefault(size, len(places)) for sizes in tried for size in sizes]
    candidate = np.repeat(np.arange(len(tried)), [len(sizes) for sizes in tried])
    return list(places), np.array(place, dtype=np.int64), candidate
