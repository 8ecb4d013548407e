"""Writes live frames to a folder, so that they can be tracked again."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from PIL import Image

from common.frame import DepthFrame
from coordinator.files import CAMERA_FILE
from coordinator.sources.camera import write_camera
from coordinator.sources.live import find_misfit
from coordinator.sources.picture_folders import TIMES_FILE

WAITING_FRAMES = 60  # largest number that wait to be written: 40 MB of 640 x 480


class FrameRecorder:
    """Writes frames on a thread of its own, in the format of Open3D's recorders with a file of times.

    Images are named by the numbers of their frames. Frames of another camera, or of a publisher that started
    again, get a folder of their own: DIR-2 and so on. `put` never waits. Frames that cannot be written, or
    come while too many wait, are counted; `report` is called with the first error.
    """

    def __init__(self, folder: Path, report: Callable[[str], None]) -> None:
        self.folders: list[Path] = []
        self.written = 0
        self._folder, self._report = folder, report
        self._put = 0
        self._last: DepthFrame | None = None  # that was written
        self._failed = False
        self._waiting = queue.Queue[DepthFrame | None](WAITING_FRAMES)
        self._thread = threading.Thread(target=self._write_all, daemon=True)
        self._thread.start()

    def put(self, frame: DepthFrame) -> None:
        """Write a frame soon, unless too many wait."""
        self._put += 1
        with suppress(queue.Full):
            self._waiting.put_nowait(frame)

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
        with (folder / TIMES_FILE).open("a", encoding="utf-8") as times:
            times.write(f"{frame.time_s!r} {name}\n")
        self._last = frame
