"""Nested names and values, as JSON holds them, in a row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def flatten(configuration: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Pairs of dotted name and value."""
    for key, value in configuration.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
