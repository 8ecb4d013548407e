"""A depth sequence of the UTD Multimodal Human Action Dataset (Chen, Jafari, Kehtarnavaz, ICIP 2015).

A Kinect v1 recorded it: 320 x 240 at 30 frames a second, millimetres, the person already cut out. The
data set ships no intrinsics; the vendor's nominal ones are used. The pictures are mirror images and are
read as they are, so the limb at image left of a person who faces the camera is the person's right limb.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.sources.camera import MILLIMETRES
from coordinator.sources.source import Recording

KINECT = Intrinsics(320, 240, 285.63, 285.63, 160.0, 120.0)
FPS = 30.0
VARIABLE = "d_depth"
MEND = "give one of the data set's *_depth.mat files"


class UtdMhadFile(Recording):
    """The frames of one `.mat` file, numbered from 0."""

    intrinsics = KINECT
    fps = FPS

    def __init__(self, path: Path) -> None:
        self.name = path.stem
        self._depth = read_depth(path)  # (H, W, F)
        self.numbers = range(self._depth.shape[2])

    def frame(self, number: int) -> DepthFrame:
        """One frame, in millimetres."""
        depth = np.ascontiguousarray(self._depth[:, :, number])
        return DepthFrame(number, number / FPS, depth, MILLIMETRES, KINECT)


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Depth (240, 320, F) in millimetres; InputError if the file is damaged or holds something else."""
    from scipy.io import loadmat  # takes long to load

    try:
        content = loadmat(path, variable_names=[VARIABLE])
    except Exception as error:  # a damaged file makes the reader raise whatever it stumbles over
        raise InputError(f"{path} is damaged or no MATLAB 5 file ({error}); copy it again") from error
    if VARIABLE not in content:
        raise InputError(f"{path} has no variable '{VARIABLE}'; give one of the data set's *_depth.mat files")
    depth = np.asarray(content[VARIABLE])
    if depth.ndim == 2:
        depth = depth[:, :, None]  # MATLAB drops a last axis of one frame
    if depth.ndim != 3 or depth.shape[:2] != (KINECT.height, KINECT.width) or not depth.shape[2]:
        raise InputError(f"{path}: {VARIABLE} has shape {depth.shape}, not (240, 320, frames); {MEND}")
    with np.errstate(invalid="ignore"):
        whole = depth.astype(np.uint16) if depth.dtype.kind in "iuf" else None
    if whole is None or not np.array_equal(whole, depth):
        raise InputError(f"{path}: {VARIABLE} holds more than whole millimetres as {depth.dtype}; {MEND}")
    return whole
