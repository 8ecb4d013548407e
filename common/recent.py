"""Keeps the most recently used values. Both sides use it for a run."""

from __future__ import annotations

from collections.abc import Collection
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

FRAMES_KEPT = 8  # of a run: the current and the next ones of some people, and those of a search
MODELS_KEPT = 16  # of a run


def put_recent(values: dict[K, V], key: K, value: V, size: int, needed: Collection[K] = ()) -> V:
    """Put a value last, and keep the last `size` ones besides those that are needed; returns the value."""
    values.pop(key, None)
    values[key] = value
    for old in [key for key in values if key not in needed][:-size]:
        del values[old]
    return value
