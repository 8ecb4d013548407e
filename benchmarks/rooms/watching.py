"""What was cut out of each frame, beside the person's own pixels."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame
from coordinator.tracking.observing.isolation import Isolated, Isolation

Mask = NDArray[np.bool_]


class WatchedIsolation(Isolation):
    """An isolation that remembers how many pixels it cut out of each frame, and how many of them were right.

    Args:
        points: How many pixels to pick at the most.
        masks: The person's own pixels (F, H, W), by frame number.
    """

    def __init__(self, points: int, masks: Mask) -> None:
        super().__init__(points)
        self._masks = masks
        self.cut_out = np.zeros(len(masks), dtype=np.int64)
        self.right = np.zeros(len(masks), dtype=np.int64)
        self.seconds = list[float]()  # of processor time that each cut took

    def cut(self, frame: DepthFrame, *around: Any, **others: Any) -> Isolated:
        """As usual."""
        began = time.process_time()
        isolated = super().cut(frame, *around, **others)
        self.seconds.append(time.process_time() - began)
        mine = self._masks[frame.number]
        cut = whole_mask(isolated.subject, mine.shape)
        self.cut_out[frame.number], self.right[frame.number] = cut.sum(), (cut & mine).sum()
        return isolated

    @property
    def mask_precision(self) -> float:
        """Share of the pixels that were cut out that are the person's, of all frames."""
        return float(self.right.sum() / max(1, self.cut_out.sum()))

    @property
    def mask_recall(self) -> float:
        """Share of the person's pixels that were cut out, of all frames."""
        return float(self.right.sum() / max(1, self._masks.sum()))


def whole_mask(subject: SubjectFrame | None, shape: tuple[int, ...]) -> Mask:
    """The pixels (H, W) of the whole picture that show a subject."""
    mask = np.zeros(shape, dtype=np.bool_)
    if subject is not None:
        left, top = -subject.view[0], -subject.view[1]
        rows, columns = subject.frame.depth.shape
        mask[top : top + rows, left : left + columns] = subject.frame.depth > 0
    return mask
