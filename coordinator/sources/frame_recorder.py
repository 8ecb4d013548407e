"""Writes live frames to a folder, so that they can be tracked again."""

from __future__ import annotations

import errno
import io
import os
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path

from PIL import Image

from gepf.common.errors import GepfError, ProtocolError
from gepf.common.frame import Frame, View
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
    while too many wait, are counted, and the next ones are tried again; `report` is called with the first
    error. Colour images that come before their frames are written to `color/`.

    No error of writing is raised, so that none prevents the results of the run.
    """

    def __init__(self, folder: Path, cameras: Sequence[LiveCamera], report: Callable[[str], None]) -> None:
        self.written = 0
        self._folder, self._cameras, self._report = folder, cameras, report
        self._put = 0
        self._folders: dict[str, list[Path]] = {each.camera: [] for each in cameras}  # by camera
        self._last = dict[str, View]()  # that began a folder or was written, by camera
        self._failed = False
        self._receiving = threading.Lock()  # colours come on a thread for each camera
        self._colours = dict[tuple[str, int], bytes]()  # JPEG files by camera and number, the last ones
        self._waiting = queue.Queue[View | None](WAITING_FRAMES)
        self._thread = threading.Thread(target=self._write_all, daemon=True)
        self._thread.start()

    @property
    def folders(self) -> list[Path]:
        """The folders of all cameras."""
        return [folder for each in self._folders.values() for folder in each]

    def put(self, frame: Frame) -> None:
        """Write the images of a frame soon, unless too many wait."""
        for view in frame.views:
            self._put += 1
            with suppress(queue.Full):
                self._waiting.put_nowait(view)

    def put_colour(self, camera: str, payload: bytes) -> None:
        """Keep the colour image in a message for its frame; malformed messages are ignored."""
        with suppress(ProtocolError):
            number, jpeg = decode_colour(payload)
            with self._receiving:
                put_recent(self._colours, (camera, number), jpeg, WAITING_FRAMES)

    def close(self) -> int:
        """Write what waits; returns the number of images that were not written."""
        if self._thread.is_alive():
            self._waiting.put(None)
            self._thread.join()
        listed = [
            RigCamera(each.camera, each.camera, each.T_rig_camera.tolist())
            for each in self._cameras
            if each.camera and (self._folder / each.camera / TIMES_FILE).exists()
        ]
        if listed:
            try:
                write_rig(self._folder / RIG_FILE, listed)
            except (OSError, GepfError) as error:
                self._report(f"the rig file of {self._folder} cannot be written: {describe(error)}")
        return self._put - self.written

    def _write_all(self) -> None:
        while (view := self._waiting.get()) is not None:
            try:
                self._write(view)
                self.written += 1
            except Exception as error:  # noqa: BLE001 whatever it is, the next frame is tried
                if not self._failed:
                    self._report(f"frames cannot be written to {self._folder}: {describe(error)}")
                self._failed = True

    def _write(self, view: View) -> None:
        last, folders = self._last.get(view.camera), self._folders[view.camera]
        if last is None or find_misfit(view, last):
            folders.append(self._begin(view.camera))
            self._last[view.camera] = view
        folder, name = folders[-1], f"{view.number:06d}.png"
        if not (folder / CAMERA_FILE).exists():
            write_camera(folder / CAMERA_FILE, view.intrinsics, view.depth_scale)
        png = io.BytesIO()
        Image.fromarray(view.depth).save(png, "PNG", compress_level=1)
        with self._receiving:
            jpeg = self._colours.get((view.camera, view.number))
        # the depth comes last: the times and colours of frames without depth are not read
        append_whole(folder / TIMES_FILE, f"{view.time_s!r} {name}\n".encode())
        if jpeg is not None:
            (folder / "color").mkdir(exist_ok=True)
            write_whole((folder / "color" / name).with_suffix(".jpg"), jpeg)
        write_whole(folder / "depth" / name, png.getbuffer())
        self._last[view.camera] = view

    def _begin(self, camera: str) -> Path:
        """Make the next folder of a camera."""
        folder = self._folder / camera
        if self._folders[camera]:
            named = (folder.with_name(f"{folder.name}-{n}") for n in count(2))
            folder = next(each for each in named if not each.exists())
        (folder / "depth").mkdir(parents=True, exist_ok=True)
        return folder


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write a file, or none: what could be written before an error is removed."""
    try:
        path.write_bytes(content)
    except OSError:
        with suppress(OSError):
            path.unlink()
        raise


def append_whole(path: Path, line: bytes) -> None:
    """Append a line, or nothing: what could be written before an error is cut off."""
    with path.open("ab", buffering=0) as file:
        size, written = file.tell(), 0
        try:
            written = file.write(line)
        finally:
            if written < len(line):
                file.truncate(size)
    if written < len(line):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def describe(error: Exception) -> str:
    """The reason of an error, without the file."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
