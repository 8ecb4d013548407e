"""Depth sequences as they are found on disk, whole and damaged."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.io import savemat

from common.errors import InputError
from coordinator.sources import open_source
from coordinator.sources.source import select_frames
from tests.support.refusals import refused

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
UTD = DATA / "utd_mhad" / "depth" / "a9_s2_t1_depth.mat"
DANCE = DATA / "skinned" / "dance_clean"

CAMERA: dict[str, Any] = {
    "width": 8,
    "height": 6,
    "intrinsic_matrix": [10.0, 0, 0, 0, 11.0, 0, 4.0, 3.0, 1],
    "depth_scale": 1000,
    "fps": 15,
}


def write_folder(path: Path, frames: NDArray[np.uint16], first: int = 0, **camera: object) -> Path:
    """A recorded folder of frames (F, H, W)."""
    (path / "depth").mkdir(parents=True)
    for number, depth in enumerate(frames, start=first):
        Image.fromarray(depth).save(path / "depth" / f"{number:06d}.png")
    (path / "camera_intrinsic.json").write_text(json.dumps(CAMERA | camera))
    return path


@pytest.fixture
def frames() -> NDArray[np.uint16]:
    """Three frames of 6 x 8 with values over the whole range."""
    return np.random.default_rng(0).integers(0, 65536, (3, 6, 8), dtype=np.uint16)


@pytest.fixture
def folder(tmp_path: Path, frames: NDArray[np.uint16]) -> Path:
    """A whole recorded folder."""
    return write_folder(tmp_path / "walk", frames)


def read_all(path: Path) -> None:
    """Open a sequence and read every frame."""
    list(open_source(path))


def test_a_folder_gives_back_what_was_recorded(folder: Path, frames: NDArray[np.uint16]) -> None:
    """Every value, number, time and the camera come through, the matrix being column by column."""
    source = open_source(folder)
    read = list(source)
    assert source.name == "walk"
    assert len(source) == 3
    assert [frame.number for frame in read] == [0, 1, 2]
    assert [frame.time_s for frame in read] == [0.0, 1 / 15, 2 / 15]
    np.testing.assert_array_equal([frame.depth for frame in read], frames)
    camera = read[0].intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (10.0, 11.0, 4.0, 3.0)
    assert read[0].metres()[0, 0] == np.float32(frames[0, 0, 0]) / np.float32(1000)


def test_truth_and_start_are_named_only_where_they_are(folder: Path) -> None:
    """A source points at files that exist."""
    assert open_source(folder).truth is None
    (folder / "truth.npz").touch()
    (folder / "init.json").touch()
    source = open_source(folder)
    assert (source.truth, source.init) == (folder / "truth.npz", folder / "init.json")


def test_what_other_programs_leave_in_the_folder_is_passed_over(folder: Path) -> None:
    """Hidden files and other kinds of file are no frames."""
    (folder / "depth" / "._000000.png").write_bytes(b"x")
    (folder / "depth" / "Thumbs.db").write_bytes(b"x")
    assert len(open_source(folder)) == 3


def altered(alter: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """Write a file's content anew."""
    return lambda path: path.write_bytes(alter(path.read_bytes()))


def picture(*shape: int, dtype: type[np.unsignedinteger[Any]] = np.uint8) -> Callable[[Path], object]:
    """Write another picture."""
    return lambda path: Image.fromarray(np.zeros(shape, dtype)).save(path)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (altered(lambda content: content[: len(content) // 2]), "damaged"),
        (altered(lambda content: content[:-12]), "damaged"),  # the closing chunk
        (altered(lambda content: content[:-18] + bytes([content[-18] ^ 0x55]) + content[-17:]), "damaged"),
        (altered(lambda _: b"depth"), "no PNG"),
        (altered(lambda _: b""), "no PNG"),
        (picture(6, 8), "8-bit, not 16-bit grey"),
        (picture(6, 8, 3), "RGB, not 16-bit grey"),
        (picture(8, 6, dtype=np.uint16), "6x8, but camera_intrinsic.json says 8x6"),
    ],
    ids=["half", "no end", "altered", "text", "empty", "8 bits", "colour", "size"],
)
@pytest.mark.parametrize("number", [0, 2])
def test_a_damaged_picture_is_found_and_named(
    folder: Path, damage: Callable[[Path], object], says: str, number: int
) -> None:
    """First frame or last: one line that names the file and what is wrong with it."""
    damage(folder / "depth" / f"{number:06d}.png")
    with refused(f"{number:06d}.png.*{says}|{says}.*{number:06d}.png"):
        read_all(folder)


@pytest.mark.parametrize(
    ("name", "says"),
    [("copy.png", r"copy\.png is not named by a frame number"), ("1.png", "names a frame number twice")],
)
def test_pictures_that_cannot_be_ordered_are_refused(folder: Path, name: str, says: str) -> None:
    """No number in the name, or 1.png beside 000001.png."""
    (folder / "depth" / name).touch()
    with pytest.raises(InputError, match=says):
        open_source(folder)


@pytest.mark.parametrize(
    ("entries", "says"),
    [
        ({"width": ...}, "width"),
        ({"depth_scale": ...}, "depth_scale"),
        ({"intrinsic_matrix": [float("nan"), 0, 0, 0, 11, 0, 4, 3, 1]}, "NaN is not a number"),
        ({"intrinsic_matrix": [10, 0, 4, 0, 11, 3, 0, 0, 1]}, "read column by column: intrinsics are not"),
        ({"intrinsic_matrix": [10, 0, 0, 0, -11, 0, 4, 3, 1]}, "with positive fx, fy"),
        ({"intrinsic_matrix": [10, 0, 0]}, "length >= 9"),
        ({"intrinsic_matrix": ["10", 0, 0, 0, 11, 0, 4, 3, 1]}, "intrinsic_matrix"),
        ({"depth_scale": 0}, "depth_scale"),
        ({"width": 0}, "width"),
        ({"fps": -1}, "fps"),
    ],
)
def test_a_camera_that_makes_no_sense_is_refused(folder: Path, entries: dict[str, object], says: str) -> None:
    """Every entry of the camera file but the rate has to be there, of its type and range, and finite."""
    content = {name: value for name, value in (CAMERA | entries).items() if value is not ...}
    (folder / "camera_intrinsic.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=says):
        open_source(folder)


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe{", b"[]", b'{"width": 1e999}', b"[" * 100_000],
    ids=["empty", "cut", "no text", "a list", "too large a number", "too deep"],
)
def test_a_camera_file_that_is_no_json_object_is_refused(folder: Path, content: bytes) -> None:
    """Whatever the file holds, the error is ours."""
    (folder / "camera_intrinsic.json").write_bytes(content)
    with pytest.raises(InputError, match=r"camera_intrinsic\.json"):
        open_source(folder)


def test_a_missing_camera_file_says_what_to_write(folder: Path) -> None:
    """The mend names the keys."""
    (folder / "camera_intrinsic.json").unlink()
    with pytest.raises(InputError, match=r"is missing; add --intrinsics .*or write it with width, height, "):
        open_source(folder)


def test_a_path_without_a_sequence_says_what_was_expected(tmp_path: Path) -> None:
    """No path and an empty folder each have their line."""
    with pytest.raises(InputError, match="no such file or folder"):
        open_source(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"holds no depth sequence .* TUM RGB-D folder \(depth\.txt\), ROS"):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("wanted", "frames"),
    [(None, range(10, 20)), ("12:15", range(12, 15)), (":12", range(10, 12)), ("18:", range(18, 20))],
)
def test_a_range_is_half_open_and_either_end_may_be_left_out(wanted: str | None, frames: range) -> None:
    """As Python's slices, over the frames' own numbers."""
    assert select_frames(range(10, 20), wanted) == frames


@pytest.mark.parametrize(
    "wanted", ["0:12", "12:21", "15:15", "15:12", "20:", "-3:", "a:b", "12", "1:2:3", ""]
)
def test_a_range_beyond_the_frames_names_those_that_there_are(wanted: str) -> None:
    """Out of range, empty, backwards, and no range at all."""
    with pytest.raises(InputError, match="this sequence has frames 10:20"):
        select_frames(range(10, 20), wanted)


def write_mat(path: Path, depth: NDArray[Any], name: str = "d_depth") -> Path:
    """A compressed MATLAB 5 file, as the data set's."""
    savemat(path, {name: depth}, do_compression=True)
    return path


def test_a_utd_file_gives_its_frames(tmp_path: Path) -> None:
    """The last axis is time; millimetres, 30 frames a second, the nominal camera."""
    depth = np.random.default_rng(0).integers(0, 4000, (240, 320, 2), dtype=np.uint16)
    source = open_source(write_mat(tmp_path / "a1_s1_t1_depth.mat", depth))
    read = list(source)
    assert source.name == "a1_s1_t1_depth"
    np.testing.assert_array_equal(read[1].depth, depth[:, :, 1])
    assert (read[1].time_s, read[1].depth_scale, read[1].intrinsics.fx) == (1 / 30, 1000.0, 285.63)


def test_a_utd_file_of_one_frame_or_of_doubles_is_read_too(tmp_path: Path) -> None:
    """MATLAB drops a last axis of length one, and may keep whole numbers as doubles."""
    depth = np.random.default_rng(0).integers(0, 4000, (240, 320)).astype(np.float64)
    source = open_source(write_mat(tmp_path / "one.mat", depth))
    assert len(source) == 1
    np.testing.assert_array_equal(source.frame(0).depth, depth)


@pytest.mark.parametrize(
    ("depth", "name", "says"),
    [
        (np.zeros((240, 320, 1), np.uint16), "d_skel", "no variable 'd_depth'"),
        (np.zeros((240, 320, 0), np.uint16), "d_depth", "has shape"),
        (np.full((240, 320, 1), 0.5), "d_depth", "whole millimetres"),
        (np.full((240, 320, 1), -1.0), "d_depth", "whole millimetres"),
    ],
)
def test_a_mat_file_of_something_else_is_refused(
    tmp_path: Path, depth: NDArray[Any], name: str, says: str
) -> None:
    """A skeleton file, another shape, and numbers that are no depth."""
    with pytest.raises(InputError, match=says):
        open_source(write_mat(tmp_path / "x.mat", depth, name))


def test_a_damaged_mat_file_is_refused_whatever_the_damage(tmp_path: Path) -> None:
    """Cut anywhere, or with any byte changed, it either reads as before or gives an error of ours."""
    depth = np.random.default_rng(0).integers(0, 9, (240, 320, 1), dtype=np.uint16)
    path = write_mat(tmp_path / "x.mat", depth)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    refused = []
    for place in rng.integers(0, len(whole), 25):
        changed = bytearray(whole)
        changed[place] ^= 1 << rng.integers(8)
        for content in (whole[:place], bytes(changed)):
            path.write_bytes(content)
            try:
                np.testing.assert_array_equal(open_source(path).frame(0).depth, depth[:, :, 0])
            except InputError as error:
                refused.append(str(error))
    assert len(refused) >= 40
    assert not any("\n" in line for line in refused)


@pytest.mark.skipif(not UTD.exists(), reason="the UTD-MHAD data are not there")
def test_a_real_utd_recording_shows_a_person_at_three_metres() -> None:
    """Shape, unit and camera agree with what the data set says of itself."""
    source = open_source(UTD)
    frame = source.frame(len(source) // 2)
    seen = frame.metres()[frame.depth > 0]
    assert 3000 < len(seen) < 7500
    assert 2.3 < np.median(seen) < 3.2


@pytest.mark.skipif(not DANCE.exists(), reason="the skinned data are not there")
def test_a_real_folder_is_read_whole() -> None:
    """Another program's folder, with truth, passes all checks."""
    source = open_source(DANCE)
    assert [frame.number for frame in source] == list(range(90))
    assert source.truth is not None
