"""When to search for the body: at first, when it is lost or gone, and at intervals while in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from gepf.coordinator.tracking.gating import Gate

LOST_RESIDUAL = 1.3  # normalised; above it a frame is badly explained. Usual frames are below 1.2
PATIENCE_FRAMES = 2  # after more successive badly explained frames the body is searched for
SEARCH_INTERVAL_FRAMES = 4  # between searches for an unknown body, and from detection to the first check
CHECK_INTERVAL_FRAMES = 10  # between checks while the pose is doubtful
FACING_DOUBT = "front and back look alike: it may face the other way"


@dataclass(frozen=True, slots=True)
class TrackManagement:
    """The recent history of a track; counts are in frames.

    is_lost: the body may be anywhere (status `searching`). tracked: frames since the last detection; less if
    the body is checked sooner.
    unexplained: successive frames that the body does not explain. frames_searched: since the first search for
    an unknown body; a live search counts as the frames of its interval. residual, why: of the last frame.
    pixels: of the body in the last explained frame. ambiguous_facing: in the last search, front and back
    explained the frame equally well.
    """

    is_lost: bool = False
    tracked: int = 0
    unexplained: int = 0
    frames_searched: int = 0
    residual: float = 0.0
    why: str = ""
    pixels: int = 0
    ambiguous_facing: bool = False

    @property
    def search_due(self) -> bool:
        """Whether to search for an unknown body in the present frame."""
        return self.frames_searched % SEARCH_INTERVAL_FRAMES == 0

    @property
    def check_due(self) -> bool:
        """Whether to search for the body again: lost, new, or in doubt."""
        new = self.tracked == SEARCH_INTERVAL_FRAMES - 1
        due = self.tracked % CHECK_INTERVAL_FRAMES == CHECK_INTERVAL_FRAMES - 1
        return self.is_lost or new or (due and (self.residual > 1.0 or self.ambiguous_facing))

    @property
    def reason(self) -> str:
        """Why the pose is doubtful, as text."""
        return self.why or (FACING_DOUBT if self.ambiguous_facing else "")

    def nothing_seen(self) -> Self:
        """After a frame that does not show the body at its place."""
        return replace(self, is_lost=True, frames_searched=0, why="", ambiguous_facing=False)

    def checked_next(self) -> Self:
        """The body is searched for in the next frame, and is in doubt for a while, as after a detection."""
        return replace(self, tracked=SEARCH_INTERVAL_FRAMES - 1)

    def not_found(self, why: str, frames: int = 1) -> Self:
        """After so many frames in which an unknown body was not found, or not searched for."""
        return replace(self, frames_searched=self.frames_searched + frames, why=why)

    def updated(self, gate: Gate, pixels: int, *, redetected: bool) -> Self:
        """After a frame that shows the body with so many pixels, tracked or detected elsewhere."""
        after = replace(self, tracked=self.tracked + 1, residual=gate.residual, why=gate.why)
        if gate.residual <= (1.0 if self.is_lost else LOST_RESIDUAL):
            after = replace(after, is_lost=False, unexplained=0, frames_searched=0, pixels=pixels)
            return replace(after, tracked=0) if redetected else after
        unexplained = self.unexplained + 1
        is_lost = self.is_lost or unexplained > PATIENCE_FRAMES
        return replace(after, is_lost=is_lost, unexplained=unexplained)


GIVEN = TrackManagement(tracked=CHECK_INTERVAL_FRAMES)
"""Of a body with a given start: it is checked only while in doubt."""
