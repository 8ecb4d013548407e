"""When to look for the body: at first, when it is lost or gone, and now and then while in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from coordinator.tracking.gating import LEAST_PIXELS, Gate

LOST_RESIDUAL = 1.3  # normalised, from which a tracked body is badly explained: usual frames stay below 1.2
PATIENCE_FRAMES = 2  # in a row that may be badly explained before the body is looked for
SEARCH_INTERVAL_FRAMES = 4  # between searches for an unknown body, and checks of one that was just detected
CHECK_INTERVAL_FRAMES = 10  # between later checks, while the pose is in doubt
GONE_SHARE = 0.35  # of the body's pixels in the last good frame, below which it may have left
FACING_DOUBT = "front and back look alike: it may face the other way"


@dataclass(frozen=True, slots=True)
class TrackManagement:
    """How the track went lately, in frames.

    seeks: the body may be anywhere. tracked: since the last detection. unexplained: in a row. searched: since
    the first search for an unknown body. residual, why: of the last frame. pixels: of the body in the last
    frame that it explained. ambiguous_facing: in the last search, front and back explained the frame about
    as well.
    """

    seeks: bool = False
    tracked: int = 0
    unexplained: int = 0
    searched: int = 0
    residual: float = 0.0
    why: str = ""
    pixels: int = 0
    ambiguous_facing: bool = False

    @property
    def searches(self) -> bool:
        """Whether to search for an unknown body in the present frame."""
        return self.searched % SEARCH_INTERVAL_FRAMES == 0

    @property
    def checks(self) -> bool:
        """Whether to look elsewhere, though the body seems to be where it is."""
        new = self.tracked < CHECK_INTERVAL_FRAMES
        interval = SEARCH_INTERVAL_FRAMES if new else CHECK_INTERVAL_FRAMES
        due = self.tracked % interval == interval - 1
        return self.seeks or (due and (new or self.residual > 1.0 or self.ambiguous_facing))

    @property
    def reason(self) -> str:
        """What speaks against the pose, in words."""
        return self.why or (FACING_DOUBT if self.ambiguous_facing else "")

    def least_pixels(self, points: int) -> float:
        """Pixels from which the body may still be where it was, if so many points are picked."""
        return max(min(LEAST_PIXELS, points), GONE_SHARE * self.pixels)

    def nothing_seen(self) -> Self:
        """After a frame that does not show the body where it was."""
        return replace(self, seeks=True, searched=0, why="", ambiguous_facing=False)

    def not_found(self, why: str) -> Self:
        """After a frame in which an unknown body was searched for, or waited for, in vain."""
        return replace(self, searched=self.searched + 1, why=why)

    def updated(self, gate: Gate, pixels: int, *, redetected: bool) -> Self:
        """After a frame with so many pixels of the body, which was tracked, or detected elsewhere."""
        if gate.residual <= (1.0 if self.seeks else LOST_RESIDUAL):
            tracked = 0 if redetected else self.tracked + 1
            facing = self.ambiguous_facing
            return type(self)(
                tracked=tracked, residual=gate.residual, why=gate.why, pixels=pixels, ambiguous_facing=facing
            )
        unexplained = self.unexplained + 1
        return replace(
            self,
            seeks=self.seeks or unexplained > PATIENCE_FRAMES,
            tracked=self.tracked + 1,
            unexplained=unexplained,
            residual=gate.residual,
            why=gate.why,
        )


GIVEN = TrackManagement(tracked=CHECK_INTERVAL_FRAMES)
"""Of a body whose start was given: it is checked only while in doubt."""
