"""Which of several people is meant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coordinator.scene.people.candidates import Candidate
from coordinator.scene.view import SceneView

MOVED = 0.2  # least share of pixels before a background that is known, of somebody who moved
WAYS = ("best", "nearest", "largest", "moving")


@dataclass(frozen=True, slots=True)
class Person:
    """One of WAYS, or a pixel at which the person is seen, column and row."""

    way: str = "best"
    pixel: tuple[int, int] | None = None

    def choose(self, view: SceneView, found: Sequence[Candidate]) -> list[Candidate]:
        """The candidates who may be meant, the likeliest first."""
        if self.pixel is not None:
            column, row = self.pixel
            return sorted(found, key=lambda each: away_from(column, row, each))
        if self.way == "moving":
            found = [each for each in found if moved(view, each) > MOVED]
        order: dict[str, Callable[[Candidate], float]] = {
            "nearest": lambda each: float(np.median(each.points[:, 2])),
            "largest": lambda each: -float(np.sum(each.points[:, 2] ** 2)),
            "moving": lambda each: -moved(view, each),
        }
        return sorted(found, key=order[self.way]) if self.way in order else list(found)


def away_from(column: int, row: int, candidate: Candidate) -> float:
    """Pixels between a pixel and the nearest of a candidate."""
    rows, columns = np.nonzero(candidate.mask)
    return float(np.hypot(rows - row, columns - column).min())


def moved(view: SceneView, candidate: Candidate) -> float:
    """Share of a candidate's pixels of which the background is known: there they were not before."""
    return float(np.mean(view.background[candidate.mask] > 0.0))
