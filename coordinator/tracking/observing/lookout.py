"""Cuts the body out of frames near where it was, before their turn too, or whoever else is seen there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame
from coordinator.scene.scene import SceneChange
from coordinator.tracking.observing.isolation import Isolated, Isolation, PosedBody
from coordinator.tracking.observing.sighting import some_points
from coordinator.tracking.stopwatch import Stopwatch

Array = NDArray[np.float64]

STEP = 1.0  # metres that a body may go between two frames


@dataclass(frozen=True, slots=True, eq=False)
class CutOut:
    """A frame, and what it shows of the subject and of the scene."""

    frame: DepthFrame
    isolated: Isolated
    clock: Stopwatch

    @property
    def pixels(self) -> int:
        """How many show the subject."""
        return 0 if self.isolated.subject is None else self.isolated.subject.pixels


class Lookout:
    """Sees frame after frame what is near the body.

    Args:
        isolation: Cuts subjects out of frames.
    """

    def __init__(self, isolation: Isolation) -> None:
        self._isolation = isolation
        self._ahead: CutOut | None = None  # the next frame, cut out before its turn

    def recall(self, change: SceneChange) -> None:
        """Know what was known of the scene after a frame that made this change."""
        self._isolation.recall(change)

    def cut(self, frame: DepthFrame, body: PosedBody | None) -> CutOut:
        """What a frame shows near a body; near None, of whoever is the likeliest to be one."""
        ahead, self._ahead = self._ahead, None
        if ahead is not None and ahead.frame is frame:
            return ahead
        clock = Stopwatch()
        with clock.stage("isolate"):
            return CutOut(frame, self._isolation.cut(frame, body), clock)

    def cut_ahead(self, frame: DepthFrame, body: PosedBody | None) -> CutOut:
        """The same for the frame that comes next; it is kept until its turn."""
        self._ahead = self.cut(frame, body)
        return self._ahead

    def find_anybody(self, cut: CutOut, last_seen: Array, fewest: int) -> CutOut:
        """The frame with whoever shows more than what was cut out, if somebody does.

        Where that has so many pixels at the least, nobody else counts who is farther than a step from where
        the body was seen last (3,), camera frame, metres.
        """
        with cut.clock.stage("isolate"):
            found = self._isolation.anybody(cut.frame, cut.isolated.view)
        if found is None or found.pixels <= cut.pixels:
            return cut
        if cut.pixels >= fewest and not is_within_a_step(found, last_seen):
            return cut
        return replace(cut, isolated=replace(cut.isolated, subject=found))


def is_within_a_step(found: SubjectFrame, last_seen: Array) -> bool:
    """Whether somebody is where a body may have gone since it was at a place (3,) in the frame before."""
    middle = np.median(some_points(found), axis=0)
    return bool(np.linalg.norm(middle - last_seen) < STEP)
