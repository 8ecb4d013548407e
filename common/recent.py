"""Keeps the most recently used values. Coordinator and workers keep the data of runs with it."""

from __future__ import annotations

from collections.abc import Collection
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

FRAMES_KEPT = 8  # of a run: the current and the next ones of some people, and those of a search
MODELS_KEPT = 16  # of a run


def put_recent(values: dict[K, V], key: K, value: V, size: int, needed: Collection[K] = ()) -> V:
    """Add a value as the most recent; keep the `size` most recent and all `needed` ones. Returns it."""
    values.pop(key, None)
    values[key] = value
    for old in [key for key in values if key not in needed][:-size]:
        del values[old]
    return value
