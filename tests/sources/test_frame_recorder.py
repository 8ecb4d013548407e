"""`--record`: what is written when writing fails for a while, or for ever."""

from __future__ import annotations

import resource
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gepf.common.frame import Frame
from gepf.common.protocol.frames import encode_colour
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.frame_recorder import FrameRecorder
from gepf.coordinator.sources.live_stream import LiveCamera
from tests.support.live import KEY, plate_image

ALONE = [LiveCamera(KEY)]


class Heard(list[str]):
    """What a recorder reports, and an event at each report."""

    def __init__(self) -> None:
        super().__init__()
        self.came = threading.Event()

    def __call__(self, line: str) -> None:
        """Note a line."""
        self.append(line)
        self.came.set()


@contextmanager
def full_disk(size: int = 0) -> Iterator[None]:
    """No file of this process can grow beyond this size; folders can be made."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("size", [0, 40])
def test_frames_are_written_again_when_the_disk_has_room(tmp_path: Path, size: int) -> None:
    """The disk is full at the first frame, or in the middle of its files: only that one is not written."""
    said, folder = Heard(), tmp_path / "kept"
    recorder = FrameRecorder(folder, ALONE, said)
    with full_disk(size):
        recorder.put(Frame.of(plate_image(0)))
        assert said.came.wait(300.0)
    for number in range(1, 20):
        recorder.put(Frame.of(plate_image(number)))
    assert recorder.close() == 1
    assert said == [f"frames cannot be written to {folder}: File too large"]
    kept = [*open_source(folder)]
    assert [frame.number for frame in kept] == [*range(1, 20)]
    np.testing.assert_allclose([frame.time_s for frame in kept], np.arange(19) / 30.0)
    assert recorder.folders == [folder]


def test_a_later_frame_that_is_not_written_leaves_no_part(tmp_path: Path) -> None:
    """Times and depth of the others are whole, and those that follow are in the same folder."""
    said = Heard()
    recorder = FrameRecorder(tmp_path / "kept", ALONE, said)
    recorder.put(Frame.of(plate_image(0)))
    written = tmp_path / "kept" / "depth" / "000000.png"
    while not written.exists() or recorder.written < 1:
        assert not said.came.wait(0.01)
    with full_disk((tmp_path / "kept" / "timestamps.txt").stat().st_size + 4):
        recorder.put(Frame.of(plate_image(1)))
        assert said.came.wait(300.0)
    recorder.put(Frame.of(plate_image(2)))
    assert recorder.close() == 1
    kept = [*open_source(tmp_path / "kept")]
    assert [frame.number for frame in kept] == [0, 2]
    np.testing.assert_allclose([frame.time_s for frame in kept], np.array([0, 2]) / 30.0)


def test_any_error_is_reported_and_the_next_frame_is_written(tmp_path: Path) -> None:
    """An image of a type that no PNG has."""
    said = Heard()
    recorder = FrameRecorder(tmp_path / "kept", ALONE, said)
    odd = plate_image(0)
    recorder.put(Frame.of(replace(odd, depth=odd.depth.astype(np.complex64))))
    recorder.put(Frame.of(plate_image(1)))
    assert recorder.close() == 1
    assert [frame.number for frame in open_source(tmp_path / "kept")] == [1]
    assert len(said) == 1


def test_a_folder_of_another_recording_is_left_alone(tmp_path: Path) -> None:
    """A publisher that starts again gets the next folder that is not there."""
    (tmp_path / "kept-2").mkdir()
    recorder = FrameRecorder(tmp_path / "kept", ALONE, print)
    for number in (5, 6, 1, 2):
        recorder.put(Frame.of(plate_image(number)))
    assert recorder.close() == 0
    assert not any((tmp_path / "kept-2").iterdir())
    assert [frame.number for frame in open_source(tmp_path / "kept-3")] == [1, 2]


def test_a_rig_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    """It raises nothing; the images of the cameras are there."""
    said, cameras = Heard(), [LiveCamera(f"{KEY}/{name}", name) for name in ("left", "right")]
    recorder = FrameRecorder(tmp_path / "kept", cameras, said)
    left, right = (replace(plate_image(0), camera=each.camera) for each in cameras)
    (tmp_path / "kept" / "rig.json").mkdir(parents=True)
    recorder.put(Frame.of(left, right))
    assert recorder.close() == 0
    assert len(said) == 1
    assert said[0].startswith(f"the rig file of {tmp_path / 'kept'} cannot be written: ")
    assert all([*open_source(tmp_path / "kept" / each.camera)] for each in cameras)


def test_the_colours_of_two_cameras_come_at_once(tmp_path: Path) -> None:
    """From a thread for each; the last ones of all are kept."""
    cameras = [LiveCamera(f"{KEY}/{name}", name) for name in ("left", "right")]
    recorder = FrameRecorder(tmp_path / "kept", cameras, print)
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:

        def put(camera: str) -> None:
            for number in range(3000):
                recorder.put_colour(camera, encode_colour(number, b"\xff\xd8"))

        with ThreadPoolExecutor() as pool:
            for done in [pool.submit(put, each.camera) for each in cameras]:
                done.result()
    finally:
        sys.setswitchinterval(usual)
    recorder.put_colour("left", encode_colour(9999, b"\xff\xd8 last"))
    left = replace(plate_image(9999), camera="left")
    recorder.put(Frame.of(left))
    assert recorder.close() == 0
    assert (tmp_path / "kept" / "left" / "color" / "009999.jpg").read_bytes() == b"\xff\xd8 last"
