"""A depth sequence of the UTD Multimodal Human Action Dataset (Chen, Jafari, Kehtarnavaz, ICIP 2015).

It was recorded by a Kinect v1: 320 x 240, millimetres, with the person already segmented. The data set has
no intrinsics; the nominal ones of the vendor are used. It has no times either. The gyroscope that the people
wore (50 samples per second) has 2.65 samples per depth frame: 19 frames per second, not the Kinect's 30. The
images are mirrored and are not mirrored back: the limb at image left of a person who faces the camera is the
person's right limb.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources.camera import MILLIMETRES, GivenCamera
from gepf.coordinator.sources.source import Source

KINECT = Intrinsics(320, 240, 285.63, 285.63, 160.0, 120.0)
VARIABLE = "d_depth"
FPS = 19.0  # angular speeds agree best with the gyroscope at 17.5 to 19.7, by subject


def read_utd_mhad(path: Path, given: GivenCamera) -> Source:
    """Read the frames of one `.mat` file, numbered from 0; InputError for anything else."""
    from scipy.io import loadmat  # is slow to load

    try:
        content = loadmat(path, variable_names=[VARIABLE])
    except Exception as error:  # the reader can raise any exception for a damaged file
        raise InputError(f"{path} is damaged or not a MATLAB 5 file ({error}); copy it again") from error
    depth = np.atleast_3d(content.get(VARIABLE, np.empty(0)))  # MATLAB drops the last axis of a single frame
    with np.errstate(invalid="ignore"):
        whole = depth.astype(np.uint16) if depth.dtype.kind in "iuf" else np.empty(0, np.uint16)
    if whole.shape[:2] != (KINECT.height, KINECT.width) or not whole.size or not np.array_equal(whole, depth):
        raise InputError(
            f"{path} has no '{VARIABLE}' (240, 320, frames) in whole millimetres; give a *_depth.mat"
        )
    frames = np.ascontiguousarray(np.moveaxis(whole, 2, 0))
    camera = given.camera(frames.shape[1:], path) if given.intrinsics else KINECT
    scale = given.depth_scale or MILLIMETRES
    return Source(path.stem, camera, range(len(frames)), frames.__getitem__, scale, FPS)
