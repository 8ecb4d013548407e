"""Keeps the most recently used values. Both sides use it for a run."""

from __future__ import annotations

from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

FRAMES_KEPT = 8  # of a run: of each of three people the current and the next one; those of a detection
MODELS_KEPT = 16  # of a run


def put_recent(values: dict[K, V], key: K, value: V, size: int) -> V:
    """Put a value last, and drop the first ones above `size`; returns the value."""
    values.pop(key, None)
    values[key] = value
    while len(values) > size:
        del values[next(iter(values))]
    return value
