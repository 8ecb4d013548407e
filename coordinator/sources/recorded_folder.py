"""A folder as Open3D's recorders write it: depth/000000.png and camera_intrinsic.json."""

from __future__ import annotations

from pathlib import Path

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files.names import CAMERA_FILE, START_FILE, TRUTH_FILE
from coordinator.sources.camera_file import pinhole, read_camera
from coordinator.sources.depth_picture import read_depth
from coordinator.sources.source import Recording, if_there


class RecordedFolder(Recording):
    """A depth sequence in a folder. `numbers` are those of the file names, which must be consecutive."""

    def __init__(self, path: Path) -> None:
        self.name = path.resolve().name
        self._files = find_depth_files(path)
        camera = read_camera(path / CAMERA_FILE)
        self.intrinsics = pinhole(camera, path / CAMERA_FILE)
        self.depth_scale = camera.depth_scale
        self.fps = camera.fps
        self.numbers = range(min(self._files), max(self._files) + 1)
        self.truth = if_there(path / TRUTH_FILE)
        self.init = if_there(path / START_FILE)

    def frame(self, number: int) -> DepthFrame:
        """One frame, decoded and checked against the camera's size."""
        depth = read_depth(self._files[number], self.intrinsics)
        return DepthFrame(number, number / self.fps, depth, self.depth_scale, self.intrinsics)


def find_depth_files(path: Path) -> dict[int, Path]:
    """Frame number -> file, for all of `path`/depth; InputError if there is none or one is missing."""
    try:
        files = [f for f in (path / "depth").glob("*.png") if not f.name.startswith(".")]
    except OSError as error:
        raise InputError(f"cannot read {path / 'depth'}: {error.strerror}; mend its permissions") from error
    odd = next((f for f in files if not f.stem.isdecimal()), None)
    if odd is not None:
        raise InputError(f"{odd} is not named by a frame number such as 000000.png; rename or remove it")
    if not files:
        raise InputError(
            f"{path} holds no depth/000000.png; give a folder as Open3D's recorders write it "
            f"(depth/*.png and {CAMERA_FILE})"
        )
    numbered = {int(f.stem): f for f in files}
    if len(numbered) < len(files):
        raise InputError(f"{path / 'depth'} names a frame number twice; remove one file of each pair")
    missing = next((n for n in range(min(numbered), max(numbered)) if n not in numbered), None)
    if missing is not None:
        raise InputError(
            f"{path / 'depth'} has no frame {missing}, though there are later ones; "
            "put it back or number the frames without gaps"
        )
    return numbered
