"""Writes live frames to a folder, so that they can be tracked again."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from PIL import Image

from common.errors import ProtocolError
from common.frame import DepthFrame
from common.protocol.frames import decode_colour
from common.recent import put_recent
from coordinator.files import CAMERA_FILE
from coordinator.sources.camera import write_camera
from coordinator.sources.live_stream import LiveCamera, find_misfit
from coordinator.sources.picture_folders import TIMES_FILE
from coordinator.sources.rig import RIG_FILE, RigCamera, write_rig

WAITING_FRAMES = 60  # largest number that wait to be written: 40 MB of 640 x 480


class FrameRecorder:
    """Writes frames on a thread of its own, in the format of Open3D's recorders with a file of times.

    Images are named by the numbers of their frames. Frames of another camera, or of a publisher that started
    again, get a folder of their own: DIR-2 and so on. `put` never waits. Frames that cannot be written, or
    come while too many wait, are counted; `report` is called with the first error. Colour images that come
    before their frames are written to `color/`.
    """

    def __init__(self, folder: Path, report: Callable[[str], None]) -> None:
        self.folders: list[Path] = []
        self.written = 0
        self._folder, self._report = folder, report
        self._put = 0
        self._last: DepthFrame | None = None  # that was written
        self._failed = False
        self._colours = dict[int, bytes]()  # JPEG files by number, the last ones
        self._waiting = queue.Queue[DepthFrame | None](WAITING_FRAMES)
        self._thread = threading.Thread(target=self._write_all, daemon=True)
        self._thread.start()

    def put(self, frame: DepthFrame) -> None:
        """Write a frame soon, unless too many wait."""
        self._put += 1
        with suppress(queue.Full):
            self._waiting.put_nowait(frame)

    def put_colour(self, payload: bytes) -> None:
        """Keep the colour image in a message for its frame; malformed messages are ignored."""
        with suppress(ProtocolError):
            number, jpeg = decode_colour(payload)
            put_recent(self._colours, number, jpeg, WAITING_FRAMES)

    def close(self) -> int:
        """Write what waits; returns the number of frames that were not written."""
        if self._thread.is_alive():
            self._waiting.put(None)
            self._thread.join()
        return self._put - self.written

    def _write_all(self) -> None:
        while (frame := self._waiting.get()) is not None:
            try:
                self._write(frame)
                self.written += 1
            except OSError as error:
                if not self._failed:
                    self._report(f"frames cannot be written to {self._folder}: {error.strerror}")
                self._failed = True

    def _write(self, frame: DepthFrame) -> None:
        if self._last is None or find_misfit(frame, self._last):
            number = len(self.folders) + 1
            folder = self._folder if number == 1 else self._folder.with_name(f"{self._folder.name}-{number}")
            (folder / "depth").mkdir(parents=True)
            write_camera(folder / CAMERA_FILE, frame.intrinsics, frame.depth_scale)
            self.folders.append(folder)
        folder, name = self.folders[-1], f"{frame.number:06d}.png"
        Image.fromarray(frame.depth).save(folder / "depth" / name, compress_level=1)
        if (jpeg := self._colours.get(frame.number)) is not None:
            (folder / "color").mkdir(exist_ok=True)
            (folder / "color" / name).with_suffix(".jpg").write_bytes(jpeg)
        with (folder / TIMES_FILE).open("a", encoding="utf-8") as times:
            times.write(f"{frame.time_s!r} {name}\n")
        self._last = frame


class RigRecorder:
    """Writes the frames of all cameras, each into a folder of its name, and a rig file that lists them.

    A camera alone has no name, so its frames are in the folder itself.
    """

    def __init__(self, folder: Path, cameras: Sequence[LiveCamera], report: Callable[[str], None]) -> None:
        self._folder, self._cameras = folder, cameras
        self._recorders = {each.camera: FrameRecorder(folder / each.camera, report) for each in cameras}

    def put(self, frame: DepthFrame) -> None:
        """Write the images of a frame soon, unless too many wait."""
        for view in frame.views:
            self._recorders[view.camera].put(view)

    def put_colour(self, camera: str, payload: bytes) -> None:
        """Keep the colour image in a message for its frame."""
        self._recorders[camera].put_colour(payload)

    def close(self) -> int:
        """Write what waits; returns the number of images that were not written."""
        unwritten = sum(each.close() for each in self._recorders.values())
        listed = [
            RigCamera(each.camera, each.camera, each.T_rig_camera.tolist())
            for each in self._cameras
            if each.camera and self._recorders[each.camera].folders
        ]
        if listed:
            write_rig(self._folder / RIG_FILE, listed)
        return unwritten

    @property
    def folders(self) -> list[Path]:
        """The folders of all cameras."""
        return [folder for each in self._recorders.values() for folder in each.folders]

    @property
    def written(self) -> int:
        """Number of images that were written."""
        return sum(each.written for each in self._recorders.values())
