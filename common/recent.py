"""Values that were used last; the others are dropped."""

from __future__ import annotations

from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")


def keep(values: dict[K, V], key: K, value: V, size: int) -> V:
    """Put a value last, and drop the first ones above `size`; gives the value."""
    values.pop(key, None)
    values[key] = value
    while len(values) > size:
        del values[next(iter(values))]
    return value
