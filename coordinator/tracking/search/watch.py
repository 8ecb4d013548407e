"""When to look for the body anew: at first, when it is lost or gone, and now and then while in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from coordinator.scene.cutting import REACH
from coordinator.tracking.search.verdict import FEWEST, UNEXPLAINED, Verdict

LOST = 1.3  # strain from which on a body that was tracked is not: those who are stay below 1.2
PATIENCE = 2  # frames in a row that may be badly explained before the body is looked for
LONGEST_PAUSE = 5  # frames between searches for a body of which nothing is known
CHECKS = (2, 5, 9)  # frames after a find in which it is held against a new search
DOUBTFUL = 0.85  # strain from which on it is held against a search every so many frames
EVERY = 10  # frames, counted from the last of these checks
TIGHT, SETTLED = 0.12, 8  # metres from a body that was just found, and for how many frames
REMEMBERED = 60
LEFT = 0.35  # share of the body's pixels that is next to nothing, if somebody is seen elsewhere
COMPANY = "somebody else is in contact, or was near: --people 2 tracks both"
LOOKS_ALIKE = "front and back look alike: it may face the other way"
AGAIN = 5  # while front and back look alike it is searched again in every frame of this many since a find
CHOOSY = 6  # searches in which only what explains the frame well is believed


@dataclass(frozen=True, slots=True)
class Watch:
    """How it went lately; a tracker's state has it. What is counted is frames.

    seeks: the body may be anywhere. tracked: since it was found last. unexplained, failures: in a row, of
    frames and of searches for an unknown body. pause: until the next of these. strain, why: of the last.
    """

    seeks: bool = False
    tracked: int = 0
    unexplained: int = 0
    failures: int = 0
    pause: int = 0
    strain: float = 0.0
    why: str = ""
    tried: int = 0  # pixels of whoever was searched in vain last
    company: int = 0  # frames for which it is remembered that somebody else was near
    seen: int = 0  # pixels of the body in the last frame that it explained
    alike: bool = False  # front and back, in the last search

    @property
    def reach(self) -> float:
        """Metres from the body to what may be its own: little after a find, until what is still is known."""
        return TIGHT if self.tracked < SETTLED else REACH

    @property
    def checks(self) -> bool:
        """Whether to look elsewhere, though the body seems to be where it is."""
        later = self.tracked - CHECKS[-1]
        doubtful = self.strain > DOUBTFUL and later > 0 and later % EVERY == 0
        again = self.alike and self.tracked % AGAIN == 0
        return self.seeks or self.tracked in CHECKS or doubtful or again

    @property
    def reason(self) -> str:
        """What speaks against the pose, in words."""
        return self.why or (LOOKS_ALIKE if self.alike else "")

    def fewest(self, points: int) -> float:
        """Pixels where the body was from which on it may be there still, if so many points are picked."""
        return max(min(FEWEST, points), LEFT * self.seen)

    def shown(self, pixels: int) -> Self:
        """After a frame in which so many pixels were taken for the body's."""
        return self if self.seeks or self.unexplained else replace(self, seen=pixels)

    def saw_nobody(self) -> Self:
        """After a frame that shows nobody, or not where the body was."""
        return replace(self, seeks=True, pause=0, failures=0, why="", alike=False)

    def waited(self) -> Self:
        """After a frame in which an unknown body was not looked for."""
        return replace(self, pause=self.pause - 1)

    def failed(self, why: str, tried: int = 0) -> Self:
        """After a search for an unknown body that found nobody to be believed."""
        failures = self.failures + 1
        return replace(self, failures=failures, pause=min(failures, LONGEST_PAUSE) - 1, why=why, tried=tried)

    def searched(self, *, alike: bool) -> Self:
        """After a search in which who faces the other way explained the frame about as well, or did not."""
        return replace(self, alike=alike)

    def accompanied(self) -> Self:
        """After somebody else was seen near the body."""
        return replace(self, company=REMEMBERED)

    def followed(self, verdict: Verdict, *, anew: bool) -> Self:
        """After a frame in which the body was tracked, or found `anew`: when it was lost, or elsewhere."""
        company = max(0, self.company - 1)
        if verdict.strain <= (1.0 if self.seeks else LOST):
            tracked = 0 if anew else self.tracked + 1
            return type(self)(
                tracked=tracked,
                strain=verdict.strain,
                why=verdict.why,
                company=company,
                seen=self.seen,
                alike=self.alike,
            )
        unexplained = self.unexplained + 1
        return replace(
            self,
            seeks=self.seeks or unexplained > PATIENCE,
            tracked=self.tracked + 1,
            unexplained=unexplained,
            strain=verdict.strain,
            why=COMPANY if company and verdict.why == UNEXPLAINED else verdict.why,
            company=company,
        )


GIVEN = Watch(tracked=CHECKS[-1] + 1)
"""Of a body whose start was given: it is not held against a search unless there is doubt."""
