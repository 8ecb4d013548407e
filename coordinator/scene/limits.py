"""What of a frame counts, where the user says so: from how near to how far, in which part of the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from common.frame import DepthFrame


@dataclass(frozen=True, slots=True)
class Limits:
    """Metres, and left, top, right and bottom in pixels, half-open; None for no limit."""

    near: float | None = None
    far: float | None = None
    region: tuple[int, int, int, int] | None = None

    def keep(self, frame: DepthFrame) -> DepthFrame:
        """The frame, in which nothing else was measured; the same one without limits."""
        if self == Limits():
            return frame
        depth = frame.metres()
        counts = depth > 0.0
        if self.near is not None:
            counts &= depth >= self.near
        if self.far is not None:
            counts &= depth <= self.far
        if self.region is not None:
            left, top, right, bottom = self.region
            inside = np.zeros_like(counts)
            inside[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = True
            counts &= inside
        return replace(frame, depth=np.where(counts, frame.depth, np.uint16(0)))
