"""Frames that may be had before their turn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.tracking.loop import Lookahead

CAMERA = Intrinsics(2, 2, 1.0, 1.0, 0.5, 0.5)
FRAMES = [DepthFrame(n, n / 30.0, np.ones((2, 2), np.uint16), 1000.0, CAMERA) for n in range(3)]


def test_every_frame_has_its_turn_once_looked_at_or_not() -> None:
    """However often the next one is looked at, before its turn or never, the order is that of the source."""
    coming = Lookahead(FRAMES)
    seen = []
    for frame in coming:
        seen.append(frame.number)
        if frame.number != 1:
            following = FRAMES[frame.number + 1] if frame.number < 2 else None
            assert coming.peek() is following
            assert coming.peek() is following
    assert seen == [0, 1, 2]
    assert next(coming, None) is None


def test_a_frame_that_cannot_be_read_fails_at_its_turn() -> None:
    """The frame before it, during which it was looked at, is not harmed."""

    def broken() -> Iterator[DepthFrame]:
        yield FRAMES[0]
        raise InputError("frame 1 is torn")

    coming = Lookahead(broken())
    assert next(coming) is FRAMES[0]
    assert coming.peek() is None
    with pytest.raises(InputError, match="torn"):
        next(coming)
