"""What is done between the images of a live stream."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from itertools import count
from typing import Any, cast

import pytest

from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.tracking.pacing import LivePacing, Lookahead
from gepf.coordinator.tracking.search import BodySearch

STAGES = 8


class Asked:
    """A request whose answer is there when it has been asked for a while."""

    def __init__(self) -> None:
        self._looks = count()

    def poll(self) -> bool:
        """Whether it is answered."""
        return next(self._looks) > 3


class Shown:
    """A stream whose next image comes after so many looks; None: it does not come."""

    def __init__(self, shown: int | None) -> None:
        self.shown = shown
        self._looks = count()

    @property
    def is_ready(self) -> bool:
        """Whether it has come."""
        return self.shown is not None and next(self._looks) > self.shown

    def wait(self, _: float) -> None:
        """It does not come sooner."""


@dataclass
class Person:
    """What pacing knows of a person."""

    search: BodySearch | None
    is_tracked: bool
    begun: list[int]

    @property
    def needs_frame(self) -> bool:
        """Whether the person needs the next frame."""
        return self.is_tracked

    @property
    def is_searching(self) -> bool:
        """Whether a search is under way."""
        return self.search is not None and self.search.is_running


def person(*, is_tracked: bool, searches: bool) -> Any:
    """A person, perhaps with a search of some stages under way."""
    begun = list[int]()

    def stages() -> Generator[tuple[Asked, ...], None, str]:
        for number in range(STAGES):
            begun.append(number)
            yield (Asked(),)
        return "detected"

    search = BodySearch(cast("Any", stages()), None) if searches else None
    return Person(search, is_tracked, begun)


@pytest.mark.parametrize("shown", [None, 5])
def test_a_search_goes_on_between_the_images_of_a_slow_camera(shown: int | None) -> None:
    """All its stages while no image comes, beside a person who is tracked, however slow the camera is.

    An image that comes is attended to at once, and the search goes on after it.
    """
    frames = Shown(shown)
    people = [person(is_tracked=True, searches=False), person(is_tracked=False, searches=True)]
    pacing = LivePacing(cast("LiveFrames", frames), Lookahead(iter([])))
    pacing.end_frame(people)
    found = people[1].search
    if shown is not None:
        assert found.is_running
        assert 0 < len(people[1].begun) < STAGES
        frames.shown = None
        pacing.end_frame(people)
    assert len(people[1].begun) == STAGES
    assert found.detection == "detected"
