"""One depth image as it comes from a source and travels to the workers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrame:
    """A depth image with its camera and time.

    depth: uint16 (H, W), `depth_scale` units per metre, 0 where nothing was measured.
    """

    number: int
    time_s: float
    depth: NDArray[np.uint16]  # (H, W)
    depth_scale: float
    intrinsics: Intrinsics

    def metres(self) -> NDArray[np.float32]:
        """Depth (H, W) in metres, 0 where nothing was measured."""
        return self.depth.astype(np.float32) / np.float32(self.depth_scale)


UNKNOWN, SUBJECT, EMPTY, HIDDEN, UNMEASURED = 0, 1, 2, 3, 4
"""Kinds of pixels: it is unclear what was measured; the subject; something farther was, so that the subject
is not there; something nearer was, behind which it may be; nothing was."""


@dataclass(frozen=True, slots=True, eq=False)
class SubjectFrame:
    """A frame cropped to the subject: every pixel that is not the subject's is 0.

    picked: flat indices (P,) into the cropped depth, ascending: the pixels that become observed points.
    view: (left, top, right, bottom) of the camera's whole image in pixels of the crop, half-open; what
    lies outside was not seen, what lies inside it and not in the crop is known to be empty.
    kinds: uint8 (H, W) of the crop; None where all that is not the subject's is empty.
    emptiness: from 0 to 1, how surely the subject is not where nothing was measured.
    """

    frame: DepthFrame
    picked: NDArray[np.uint32]  # (P,)
    view: tuple[int, int, int, int]
    kinds: NDArray[np.uint8] | None = None  # (H, W)
    emptiness: float = 0.0

    @property
    def pixels(self) -> int:
        """How many are the subject's."""
        return int(np.count_nonzero(self.frame.depth))
