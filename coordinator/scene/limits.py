"""What of a frame counts, where the user says so: from how near to how far, in which part of the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame


@dataclass(frozen=True, slots=True)
class Limits:
    """Metres, and left, top, right and bottom in pixels, half-open; None for no limit."""

    near: float | None = None
    far: float | None = None
    region: tuple[int, int, int, int] | None = None

    def keep(self, frame: DepthFrame) -> DepthFrame:
        """The frame, in which nothing else was measured; the same one without limits."""
        return self.split(frame)[0]

    def split(self, frame: DepthFrame) -> tuple[DepthFrame, NDArray[np.bool_] | None]:
        """What `keep` and `leave_out` give."""
        left_out = self.leave_out(frame)
        if left_out is None:
            return frame, None
        return replace(frame, depth=np.where(left_out, np.uint16(0), frame.depth)), left_out

    def leave_out(self, frame: DepthFrame) -> NDArray[np.bool_] | None:
        """Pixels (H, W) that do not count, measured or not; None without limits."""
        if self == Limits():
            return None
        depth = frame.metres()
        left_out = np.zeros(depth.shape, dtype=np.bool_)
        if self.near is not None:
            left_out |= (depth > 0.0) & (depth < self.near)
        if self.far is not None:
            left_out |= depth > self.far
        if self.region is not None:
            left, top, right, bottom = self.region
            inside = np.zeros_like(left_out)
            inside[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = True
            left_out |= ~inside
        return left_out
