"""How the tracker uses the time of a frame: recorded frames wait for everything, live frames for nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Generic, Self, TypeVar

from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.tracking.particle_filter import FrameBudget
from gepf.coordinator.tracking.target import TargetTracker

POLL_S = 0.002  # between polls of the workers

Item = TypeVar("Item")


class Lookahead(Generic[Item]):
    """Iterates over items, computing each when its turn comes; `peek` computes the next one ahead of time."""

    def __init__(self, items: Iterable[Item]) -> None:
        self._items = iter(items)
        self.was_ahead = False  # whether the last item was computed ahead of time
        self.is_ahead = False  # whether the next item has been computed already
        self._next: Item | None = None  # None at the end
        self._error: Exception | None = None

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Item:
        self.was_ahead = self.is_ahead
        item = self.peek()
        self.is_ahead = False
        if self._error is not None:
            raise self._error
        if item is None:
            raise StopIteration
        return item

    def peek(self) -> Item | None:
        """The next item; None at the end, or after an error, which is raised when the item is due."""
        if not self.is_ahead:
            try:
                self._next = next(self._items, None)
            except Exception as error:  # noqa: BLE001 - no error may affect the previous item
                self._next, self._error = None, error
            self.is_ahead = True
        return self._next


class RecordedPacing:
    """Recorded frames wait for their searches.

    With `look_ahead`, the next frame is segmented while the workers refine this one, and this one is reported
    while they refine the next one.
    """

    def __init__(self, *, look_ahead: bool) -> None:
        self.looks_ahead, self.reports_at_once = look_ahead, not look_ahead

    def begin_frame(self, targets: Sequence[TargetTracker]) -> FrameBudget | None:  # noqa: ARG002
        """No budget: a recorded frame has as much time as it needs."""
        return None

    def end_frame(self, targets: Sequence[TargetTracker]) -> None:
        """Nothing is left to do: all searches have ended."""


class LivePacing:
    """Live frames wait for no search, and are reported at once.

    The next frame is segmented ahead only if it is waiting and a body was tracked before this one. Searches
    continue until a new frame is waiting and some body needs it.
    """

    reports_at_once = True

    def __init__(self, frames: LiveFrames, upcoming: Lookahead[Item]) -> None:
        self._frames, self._upcoming = frames, upcoming
        self._waited = False  # whether the current frame had to wait for the previous one
        self._is_tracked = False  # whether any body was tracked before the current frame

    def begin_frame(self, targets: Sequence[TargetTracker]) -> FrameBudget:
        """The budget of a frame: it is late if it had to wait, or if a newer one is already waiting.

        It had to wait if it was segmented while the previous one was refined, or if it came before the end of
        the searches of the previous one.
        """
        is_late = self._upcoming.was_ahead or self._waited or self._frames.is_ready
        self._is_tracked = any(target.is_tracked for target in targets)
        return FrameBudget(self._frames.period_s, is_late)

    @property
    def looks_ahead(self) -> bool:
        """Whether the next frame is segmented now."""
        return self._frames.is_ready and self._is_tracked

    def end_frame(self, targets: Sequence[TargetTracker]) -> None:
        """Continue the searches until they end or, if a body needs the next frame, until that frame waits."""
        if self._upcoming.is_ahead:
            return
        self._waited = self._frames.is_ready
        while any(target.is_searching for target in targets):
            is_needed = any(target.needs_frame for target in targets)
            if not advance_search(targets, wait=not is_needed):
                self._frames.wait(POLL_S)
            if is_needed and self._frames.is_ready:
                break


def advance_search(targets: Sequence[TargetTracker], *, wait: bool) -> bool:
    """Advance one search by a stage, preferably for a person who is not tracked; False if none advanced."""
    by_need = sorted(targets, key=lambda target: target.is_tracked)
    return any(target.search.advance(wait=wait) for target in by_need if target.search is not None)
