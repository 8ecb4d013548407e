"""The network: BlazePose landmarks `lite` (Bazarevsky et al. 2020, arXiv:2006.10204), run by LiteRT.

`pose_landmark_lite.tflite` stands beside this file, with its licence; `build` takes it from its package. The
input is 256 x 256 RGB from 0 to 1. The outputs are 39 landmarks with the logits of their visibility and
presence, of which the last six are auxiliary, a heatmap of each, the probability of a person, and a mask
that is not used here. As in MediaPipe, landmarks are moved to the nearest peak of their heatmaps.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from gepf.common.arrays import Array
from gepf.common.packages import needs
from gepf.coordinator.colour.crop import SIDE_PX, Colours

NETWORK = "BlazePose lite 0.5.1675469404"
PACKAGE, PURPOSE = "ai_edge_litert", "finding keypoints in colour"
FILE = Path(__file__).with_name("pose_landmark_lite.tflite")
OUTPUTS = {
    (1, 39 * 5): "landmarks",  # column, row, depth, logits of visibility and presence
    (1, 1): "presence",
    (1, 64, 64, 39): "heatmaps",
}
"""Shape -> output; names of outputs say nothing."""

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """What the network sees in a crop. presence: the probability that it shows a person."""

    places: Array  # (39, 2) in the crop
    visibility: Array  # (39,) probability that a landmark is in the crop and not hidden
    presence: float


def check_installed() -> None:
    """Raise MissingPackage if the extra `color` is not installed, without loading it."""
    with needs("color", PURPOSE):
        if find_spec(PACKAGE) is None:
            raise ModuleNotFoundError(name=PACKAGE)


@contextmanager
def quiet_stderr() -> Iterator[None]:
    """Drop what compiled code writes to stderr: LiteRT announces its delegate; no option prevents that."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


class PoseNetwork:
    """The network in memory. Several threads may use it.

    It runs on two `threads`: a live frame waits for it while the workers have nothing to do. Their number
    does not change the outputs.

    Raises MissingPackage if the extra `color` is not installed.
    """

    def __init__(self, threads: int = 2) -> None:
        with needs("color", PURPOSE):
            from ai_edge_litert.interpreter import Interpreter
        self._interpreter = Interpreter(model_path=str(FILE), num_threads=threads)
        with quiet_stderr():
            self._interpreter.allocate_tensors()
        (self._input,) = (each["index"] for each in self._interpreter.get_input_details())
        outputs = self._interpreter.get_output_details()
        found = {OUTPUTS.get(tuple(each["shape"].tolist())): each["index"] for each in outputs}
        self._outputs = {name: found[name] for name in OUTPUTS.values()}
        self._running = threading.Lock()

    def see(self, crop: Colours) -> Landmarks:
        """The landmarks in a crop (SIDE_PX, SIDE_PX, 3)."""
        with self._running:
            self._interpreter.set_tensor(self._input, crop[None].astype(np.float32) / np.float32(255.0))
            self._interpreter.invoke()
            out = {name: self._interpreter.get_tensor(index)[0] for name, index in self._outputs.items()}
        values = out["landmarks"].reshape(-1, 5).astype(np.float64)
        places = to_peaks(values[:, :2], out["heatmaps"])
        visibility = expit(values[:, 3]) * expit(values[:, 4])
        return Landmarks(places, visibility, float(out["presence"][0]))


def to_peaks(places: Array, heatmaps: Floats, reach: int = 3, min_peak: float = 0.5) -> Array:
    """Places (N, 2) in the crop, moved to the peaks of their heatmaps (R, C, N) if there is one nearby.

    A peak is at most `reach` cells away in each direction, and has at least the probability `min_peak`.
    """
    moved, (rows, columns) = places.copy(), heatmaps.shape[:2]
    cell_px = SIDE_PX // rows
    for n, (column, row) in enumerate(np.floor(places / cell_px).astype(int)):
        top, left = max(0, row - reach), max(0, column - reach)
        bottom, right = min(rows, row + reach + 1), min(columns, column + reach + 1)
        if top < bottom and left < right:
            share = expit(heatmaps[top:bottom, left:right, n].astype(np.float64))
            if share.max() >= min_peak:
                across, down = np.arange(left, right), np.arange(top, bottom)
                moved[n] = cell_px / share.sum() * np.array([(share @ across).sum(), (down @ share).sum()])
    return moved
