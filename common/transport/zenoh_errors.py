"""What Zenoh raises, as BusError."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from common.errors import BusError


@contextmanager
def mapped(doing: str) -> Iterator[None]:
    """Turn Zenoh's errors into BusError, without the places in its sources."""
    try:
        yield
    except zenoh.ZError as error:
        raise bus_error(doing, error) from error


def bus_error(doing: str, error: zenoh.ZError) -> BusError:
    """An error of Zenoh's as one of ours."""
    return BusError(f"{doing}: {plain(str(error))}")


def plain(text: Any) -> str:
    """Zenoh's message up to where it names its own source files."""
    return re.split(r"\.? at /", str(text), maxsplit=1)[0]
