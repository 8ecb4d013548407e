"""Writes live frames to a folder, so that they can be tracked again."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from PIL import Image

from gepf.common.errors import ProtocolError
from gepf.common.frame import DepthFrame
from gepf.common.protocol.frames import decode_colour
from gepf.common.recent import put_recent
from gepf.coordinator.files import CAMERA_FILE
from gepf.coordinator.sources.camera import write_camera
from gepf.coordinator.sources.live_stream import LiveCamera, find_misfit
from gepf.coordinator.sources.picture_folders import TIMES_FILE
from gepf.coordinator.sources.rig import RIG_FILE, RigCamera, write_rig

WAITING_FRAMES = 60  # largest number that wait to be written: 40 MB of 640 x 480


class FrameRecorder:
    """Writes images on a thread of its own, in the format of Open3D's recorders with a file of times.

    The images of a rig's cameras are written to folders of their names, and a rig file lists these. Images
    are named by the numbers of their frames. Those of another camera, or of a publisher that started again,
    get a folder of their own: DIR-2 and so on. `put` never waits. Images that cannot be written, or come
    while too many wait, are counted; `report` is called with the first error. Colour images that come before
    their frames are written to `color/`.
    """

    def __init__(self, folder: Path, cameras: Sequence[LiveCamera], report: Callable[[str], None]) -> None:
        self.written = 0
        self._folder, self._cameras, self._report = folder, cameras, report
        self._put = 0
        self._folders: dict[str, list[Path]] = {each.camera: [] for each in cameras}  # by camera
        self._last = dict[str, DepthFrame]()  # that was written, by camera
        self._failed = False
        self._colours = dict[tuple[str, int], bytes]()  # JPEG files by camera and number, the last ones
        self._waiting = queue.Queue[DepthFrame | None](WAITING_FRAMES)
        self._thread = threading.Thread(target=self._write_all, daemon=True)
        self._thread.start()

    @property
    def folders(self) -> list[Path]:
        """The folders of all cameras."""
        return [folder for each in self._folders.values() for folder in each]

    def put(self, frame: DepthFrame) -> None:
        """Write the images of a frame soon, unless too many wait."""
        for view in frame.views:
            self._put += 1
            with suppress(queue.Full):
                self._waiting.put_nowait(view)

    def put_colour(self, camera: str, payload: bytes) -> None:
        """Keep the colour image in a message for its frame; malformed messages are ignored."""
        with suppress(ProtocolError):
            number, jpeg = decode_colour(payload)
            put_recent(self._colours, (camera, number), jpeg, WAITING_FRAMES)

    def close(self) -> int:
        """Write what waits; returns the number of images that were not written."""
        if self._thread.is_alive():
            self._waiting.put(None)
            self._thread.join()
        listed = [
            RigCamera(each.camera, each.camera, each.T_rig_camera.tolist())
            for each in self._cameras
            if each.camera and self._folders[each.camera]
        ]
        if listed:
            write_rig(self._folder / RIG_FILE, listed)
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
        last, folders = self._last.get(frame.camera), self._folders[frame.camera]
        if last is None or find_misfit(frame, last):
            folder = self._folder / frame.camera
            if folders:
                folder = folder.with_name(f"{folder.name}-{len(folders) + 1}")
            (folder / "depth").mkdir(parents=True)
            write_camera(folder / CAMERA_FILE, frame.intrinsics, frame.depth_scale)
            folders.append(folder)
        folder, name = folders[-1], f"{frame.number:06d}.png"
        Image.fromarray(frame.depth).save(folder / "depth" / name, compress_level=1)
        if (jpeg := self._colours.get((frame.camera, frame.number))) is not None:
            (folder / "color").mkdir(exist_ok=True)
            (folder / "color" / name).with_suffix(".jpg").write_bytes(jpeg)
        with (folder / TIMES_FILE).open("a", encoding="utf-8") as times:
            times.write(f"{frame.time_s!r} {name}\n")
        self._last[frame.camera] = frame
