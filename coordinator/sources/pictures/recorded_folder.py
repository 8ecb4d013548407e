"""A folder of 16-bit PNG, as Open3D's recorders write it (depth/000000.png, camera_intrinsic.json), or any.

Frames may be missing, and pictures may be named by their times (`picture_names`): what is there keeps its
real time.
"""

from __future__ import annotations

import logging
from pathlib import Path

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files.names import CAMERA_FILE, START_FILE, TRUTH_FILE
from coordinator.sources.camera_file import DEFAULT_FPS, MILLIMETRES, pinhole, read_camera
from coordinator.sources.given import NOTHING, Given
from coordinator.sources.pictures.depth_picture import picture_size, read_depth
from coordinator.sources.pictures.picture_names import find_pictures
from coordinator.sources.source import Recording, if_there, rate_of

logger = logging.getLogger(__name__)


class RecordedFolder(Recording):
    """A depth sequence in a folder; `numbers` are those of the files, or counted where these are times."""

    def __init__(self, path: Path, given: Given = NOTHING) -> None:
        self.name = path.resolve().name
        folder = path / "depth" if (path / "depth").is_dir() else path
        pictures = find_pictures(folder, path)
        if not pictures:
            raise InputError(
                f"{path} holds no depth/000000.png; give a folder as Open3D's recorders write it "
                f"(depth/*.png and {CAMERA_FILE})"
            )
        self.depth_scale, self.fps = given.depth_scale or MILLIMETRES, DEFAULT_FPS
        if given.lens is None or (path / CAMERA_FILE).exists():
            camera = read_camera(path / CAMERA_FILE)
            self.intrinsics = pinhole(camera, path / CAMERA_FILE)
            self.depth_scale, self.fps = given.depth_scale or camera.depth_scale, camera.fps
        if given.lens is not None:
            self.intrinsics = given.camera(*picture_size(pictures[0].file), str(path))
        self._files = {picture.number: picture.file for picture in pictures}
        times = [picture.time_s for picture in pictures if picture.time_s is not None]
        self._times = {p.number: t for p, t in zip(pictures, times, strict=False)}
        self.fps = rate_of(times) if len(times) > 1 else self.fps
        first, last = pictures[0].number, pictures[-1].number
        whole = last - first + 1 == len(pictures)
        self.numbers = range(first, last + 1) if whole else tuple(self._files)
        if not whole:
            missing = next(number for number in range(first, last) if number not in self._files)
            logger.warning(
                "%s: %d of %d frames are missing, frame %d first; the others keep their times",
                folder, last - first + 1 - len(pictures), last - first + 1, missing,
            )  # fmt: skip
        self.truth = if_there(path / TRUTH_FILE)
        self.init = if_there(path / START_FILE)

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        time_s = self._times.get(number, number / self.fps)
        return DepthFrame(number, time_s, depth, self.depth_scale, self.intrinsics)


def holds_pictures(path: Path) -> bool:
    """Whether a folder holds PNGs, here or in depth/."""
    return (path / "depth").is_dir() or (path.is_dir() and any(path.glob("*.png")))
