"""Stereo pairs: left/ and right/ pictures with calibration.yml, matched by OpenCV's semi-global matcher.

`calibration.yml` (or .yaml, .xml, .json) is OpenCV's file storage with the names that its stereo
calibration sample writes: camera matrices M1, M2, distortions D1, D2, and the right camera's rotation R and
translation T (metres); optional fps. Depth is that of the left camera after rectification.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.sources.arrays import UNITS_PER_METRE, to_units
from coordinator.sources.camera import DEFAULT_FPS
from coordinator.sources.source import FolderRecording

Array = NDArray[np.float64]

LEFT, RIGHT = "left", "right"
CALIBRATIONS = ("calibration.yml", "calibration.yaml", "calibration.xml", "calibration.json")
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
SHAPES = {"M1": (3, 3), "M2": (3, 3), "R": (3, 3), "T": (3, 1)}
NEAREST_M = 0.7  # what is nearer is not matched
BLOCK = 5  # pixels
FRACTION = 16.0  # of a pixel, in which OpenCV gives disparities


@dataclass(frozen=True, slots=True, eq=False)
class StereoRig:
    """Two calibrated cameras: matrices (3, 3), distortions, T_right_left as R (3, 3) and T (3, 1), metres."""

    matrices: tuple[Array, Array]
    distortions: tuple[Array, Array]
    rotation: Array
    translation: Array
    fps: float


class StereoFolder(FolderRecording):
    """Pairs of pictures of the same name in left/ and right/, numbered from 0 in the order of their names."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._cv = load_opencv(path)
        rig = read_rig(find_calibration(path), self._cv)
        self._pairs = find_pairs(path)
        height, width = self._read(self._pairs[0][0]).shape
        self._size = (width, height)
        self._rectify(rig)
        self.numbers = range(len(self._pairs))
        self.fps = rig.fps

    def frame(self, number: int) -> DepthFrame:
        """The depth of one pair."""
        left, right = (
            self._cv.remap(self._read(file), *maps, self._cv.INTER_LINEAR)
            for file, maps in zip(self._pairs[number], self._maps, strict=True)
        )
        disparity = self._matcher.compute(left, right).astype(np.float64) / FRACTION
        with np.errstate(divide="ignore"):
            depth = np.where(disparity > 0, self._focal_baseline / disparity, 0.0)
        units = to_units(depth)
        return DepthFrame(number, number / self.fps, units, UNITS_PER_METRE, self.intrinsics)

    def _rectify(self, rig: StereoRig) -> None:
        """Maps that lay both pictures into one plane, the camera of the left one, and the matcher."""
        cv, size = self._cv, self._size
        (m1, m2), (d1, d2) = rig.matrices, rig.distortions
        try:
            r1, r2, p1, p2, *_ = cv.stereoRectify(
                m1, d1, m2, d2, size, rig.rotation, rig.translation, alpha=0
            )
        except cv.error as error:
            raise InputError(
                f"{self.name}: the calibration is not one of two cameras side by side; calibrate again"
            ) from error
        self._maps = [
            cv.initUndistortRectifyMap(m, d, r, p, size, cv.CV_32FC1)
            for m, d, r, p in ((m1, d1, r1, p1), (m2, d2, r2, p2))
        ]
        self._focal_baseline = -float(p2[0, 3])
        if self._focal_baseline <= 0:
            raise InputError(
                f"{self.name}: the right camera is not to the right of the left one; exchange left and right"
            )
        self.intrinsics = Intrinsics(*size, *(float(p1[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))))
        self._matcher = matcher(cv, self._focal_baseline / NEAREST_M)

    def _read(self, file: Path) -> NDArray[np.uint8]:
        """A picture in grey; InputError if it is damaged or of another size."""
        image = self._cv.imread(str(file), self._cv.IMREAD_GRAYSCALE)
        if image is None:
            raise InputError(f"{file} is damaged or no picture; copy it again")
        size = getattr(self, "_size", image.shape[::-1])
        if image.shape[::-1] != size:
            width, height = image.shape[::-1]
            raise InputError(
                f"{file} is {width}x{height}, the first picture {size[0]}x{size[1]}; all must have one size"
            )
        return np.asarray(image, dtype=np.uint8)


def load_opencv(path: Path) -> Any:
    """OpenCV, if it is installed."""
    try:
        import cv2
    except ImportError as error:
        raise InputError(
            f"{path} holds stereo pairs, which need OpenCV; pip install 'gepf[stereo]'"
        ) from error
    return cv2


def find_calibration(path: Path) -> Path:
    """The folder's calibration; InputError if there is none."""
    found = next((path / name for name in CALIBRATIONS if (path / name).is_file()), None)
    if found is None:
        raise InputError(
            f"{path} holds stereo pairs but no {CALIBRATIONS[0]}; write it with M1, D1, M2, D2, R, T (metres)"
        )
    return found


def find_pairs(path: Path) -> list[tuple[Path, Path]]:
    """Pictures that left and right have in common; InputError where one is alone."""
    sides = [
        {f.stem: f for f in (path / side).iterdir() if f.suffix.lower() in PICTURES} for side in (LEFT, RIGHT)
    ]
    alone = sorted(set(sides[0]) ^ set(sides[1]))
    if alone:
        side = RIGHT if alone[0] in sides[0] else LEFT
        raise InputError(f"{path / side} has no picture {alone[0]}, though the other side has; put it back")
    if not sides[0]:
        raise InputError(
            f"{path / LEFT} holds no picture; put left and right pictures of the same name there"
        )
    return [(sides[0][stem], sides[1][stem]) for stem in sorted(sides[0])]


def read_rig(path: Path, cv: Any) -> StereoRig:
    """The calibration in OpenCV's file storage; InputError names what is missing or misshapen."""
    try:
        storage = cv.FileStorage(str(path), cv.FILE_STORAGE_READ)
        found = {name: storage.getNode(name) for name in (*SHAPES, "D1", "D2", "fps")}
        values = {name: node.mat() for name, node in found.items() if name != "fps"}
        fps = DEFAULT_FPS if found["fps"].empty() else found["fps"].real()
    except (cv.error, SystemError) as error:
        raise InputError(f"{path} is damaged or not OpenCV's file storage; write it again") from error
    for name, shape in SHAPES.items():
        if values[name] is None or values[name].size != math.prod(shape):
            raise InputError(f"{path}: {name} is missing or not {shape[0]} x {shape[1]}; write it again")
    numbers = {
        name: np.zeros(5) if v is None else np.asarray(v, dtype=np.float64) for name, v in values.items()
    }
    if not (all(np.isfinite(v).all() for v in numbers.values()) and 0 < fps < np.inf):
        raise InputError(f"{path}: a number is not finite, or fps not positive; mend it")
    return StereoRig(
        (numbers["M1"], numbers["M2"]),
        (numbers["D1"], numbers["D2"]),
        numbers["R"].reshape(3, 3),
        numbers["T"].reshape(3, 1),
        float(fps),
    )


def matcher(cv: Any, most: float) -> Any:
    """Semi-global matching of disparities up to `most` pixels (Hirschmueller 2008)."""
    return cv.StereoSGBM_create(
        minDisparity=0,
        numDisparities=16 * math.ceil((most + 1) / 16),
        blockSize=BLOCK,
        P1=8 * BLOCK**2,
        P2=32 * BLOCK**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv.STEREO_SGBM_MODE_SGBM_3WAY,
    )
