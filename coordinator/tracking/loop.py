"""Parts of the loop over frames: items made before their turn, and the pace of live frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

Item = TypeVar("Item")


class Lookahead(Generic[Item]):
    """Iterates over items; `peek` makes the next one before its turn."""

    def __init__(self, items: Iterable[Item]) -> None:
        self._items = iter(items)
        self.was_ahead = False  # whether the last item was made before its turn
        self.is_ahead = False  # whether the next item is made already
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
        """The next item; None at the end, or if it fails, which raises the error when its turn comes."""
        if not self.is_ahead:
            try:
                self._next = next(self._items, None)
            except Exception as error:  # noqa: BLE001 - no error may affect the item before
                self._next, self._error = None, error
            self.is_ahead = True
        return self._next


@dataclass(frozen=True, slots=True)
class Pace:
    """What a live frame has time for."""

    period_s: float  # between published frames
    is_late: bool  # it had to wait, or a newer one waits already
