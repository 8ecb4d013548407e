"""A depth image from a source, and its crop that is sent to the workers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrame:
    """A depth image with its camera and time.

    depth: uint16 (H, W), `depth_scale` units per metre, 0 for no depth.
    """

    number: int
    time_s: float
    depth: NDArray[np.uint16]  # (H, W)
    depth_scale: float
    intrinsics: Intrinsics

    def metres(self) -> NDArray[np.float32]:
        """Depth (H, W) in metres, 0 for no depth."""
        return self.depth.astype(np.float32) / np.float32(self.depth_scale)


UNKNOWN, SUBJECT, EMPTY, HIDDEN, UNMEASURED = 0, 1, 2, 3, 4
"""Labels of pixels. UNKNOWN: it is unclear what was measured. SUBJECT: the subject. EMPTY: something farther
was measured, so the subject is not there. HIDDEN: something nearer was measured, and the subject may be
behind it. UNMEASURED: no depth."""


@dataclass(frozen=True, slots=True, eq=False)
class SubjectFrame:
    """A frame cropped to the subject: all other pixels are 0.

    picked: flat indices (P,) into the cropped depth, ascending: the pixels that become observed points. view:
    (left, top, right, bottom) of the camera's whole image in pixels of the crop, half-open. Pixels outside
    are unknown; pixels inside it but outside the crop are empty. kinds: labels (H, W) of the crop, uint8;
    None if all pixels but the subject's are empty.
    """

    frame: DepthFrame
    picked: NDArray[np.uint32]  # (P,)
    view: tuple[int, int, int, int]
    kinds: NDArray[np.uint8] | None = None  # (H, W)

    @property
    def pixels(self) -> int:
        """Number of pixels of the subject."""
        return int(np.count_nonzero(self.frame.depth))
