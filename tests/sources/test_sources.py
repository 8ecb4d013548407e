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

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from gepf.coordinator.sources.source import select_frames
from tests.support.recordings import read_all, write_open3d
from tests.support.refusals import refused

CAMERA = Intrinsics(8, 6, 10.0, 11.0, 4.0, 3.0)


@pytest.fixture
def frames() -> NDArray[np.uint16]:
    """Three frames of 6 x 8 with values over the whole range."""
    return np.random.default_rng(0).integers(0, 65536, (3, 6, 8), dtype=np.uint16)


@pytest.fixture
def folder(tmp_path: Path, frames: NDArray[np.uint16]) -> Path:
    """A whole recorded folder."""
    return write_open3d(tmp_path / "walk", frames, CAMERA)


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
        (altered(lambda _: b"depth"), "not a PNG"),
        (altered(lambda _: b""), "not a PNG"),
        (picture(6, 8), "8-bit, not 16-bit grey"),
        (picture(6, 8, 3), "RGB, not 16-bit grey"),
    ],
    ids=["half", "no end", "altered", "text", "empty", "8 bits", "colour"],
)
@pytest.mark.parametrize("number", [0, 2])
def test_a_damaged_picture_is_found_and_named(
    folder: Path, damage: Callable[[Path], object], says: str, number: int
) -> None:
    """First frame or last: one line that names the file and what is wrong with it."""
    damage(folder / "depth" / f"{number:06d}.png")
    with refused(f"{number:06d}.png.*{says}"):
        read_all(folder)


def test_colour_alone_is_refused_before_its_camera_is_asked_for(folder: Path) -> None:
    """Intrinsics would not help."""
    for file in (folder / "depth").iterdir():
        picture(6, 8, 3)(file)
    (folder / "camera_intrinsic.json").unlink()
    with refused("RGB, not 16-bit grey"):
        read_all(folder)


def test_a_picture_of_another_size_is_refused(folder: Path) -> None:
    """All frames have the camera's size."""
    picture(8, 6, dtype=np.uint16)(folder / "depth" / "000001.png")
    with refused("walk: frame 1 is 6x8, but its camera 8x6"):
        read_all(folder)


@pytest.mark.parametrize(
    ("name", "says"),
    [("copy.png", r"copy\.png has no frame number in its name"), ("1.png", "has a frame number twice")],
)
def test_pictures_that_cannot_be_ordered_are_refused(folder: Path, name: str, says: str) -> None:
    """No number in the name, or 1.png beside 000001.png."""
    (folder / "depth" / name).touch()
    with pytest.raises(InputError, match=says):
        open_source(folder)


def test_the_folder_of_a_run_is_no_recording(folder: Path) -> None:
    """Its pictures are results, which nobody should rename or remove."""
    (folder / "depth" / "summary.json").touch()
    (folder / "depth" / "hypotheses.png").touch()
    with pytest.raises(InputError, match="is the folder of a run; give the recording"):
        open_source(folder)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"width": ...}, "width"),
        ({"width": None}, "width"),
        ({"depth_scale": 0}, "depth_scale"),
        ({"fps": -1}, "fps"),
        ({"intrinsic_matrix": [10, 0, 4, 0, 11, 3, 0, 0, 1]}, "read column by column: intrinsics are not"),
        ({"intrinsic_matrix": [10, 0, 0, 0, -11, 0, 4, 3, 1]}, "with positive fx, fy"),
        ({"intrinsic_matrix": [10, 0, 0]}, "length >= 9"),
        ({"intrinsic_matrix": ["10", 0, 0, 0, 11, 0, 4, 3, 1]}, "intrinsic_matrix"),
        ({"intrinsic_matrix": [float("nan"), 0, 0, 0, 11, 0, 4, 3, 1]}, "malformed"),
        (b"", "truncated"),
        (b"\xff\xfe{", "truncated"),
        (b"[" * 100_000, "Expected `object`"),
        (b'{"depth_scale": 1e999}', "depth_scale|out of range"),
    ],
)
def test_a_camera_file_that_makes_no_sense_is_refused(
    folder: Path, content: dict[str, object] | bytes, says: str
) -> None:
    """Entries that are missing or of another type or range, and files without a JSON object."""
    if isinstance(content, dict):
        usual = json.loads((folder / "camera_intrinsic.json").read_bytes())
        entries = {name: value for name, value in (usual | content).items() if value is not ...}
        content = json.dumps(entries).encode()
    (folder / "camera_intrinsic.json").write_bytes(content)
    with refused(rf"camera_intrinsic\.json.*({says})"):
        open_source(folder)


MATRIX = [10.0, 0, 0, 0, 11.0, 0, 4.0, 3.0, 1]
GIVEN = GivenCamera((12.0, 13.0, 3.5, 2.5))


@pytest.mark.parametrize(
    ("name", "content", "given", "fx", "scale"),
    [
        (
            "camera_intrinsic.json",
            {"width": 8, "height": 6, "intrinsic_matrix": MATRIX},
            AS_RECORDED,
            10,
            1000,
        ),
        (
            "intrinsic.json",
            {"width": 8, "height": 6, "intrinsic_matrix": MATRIX, "depth_scale": 4000.0, "fps": 15.0},
            AS_RECORDED,
            10,
            4000,
        ),
        (
            "camera_intrinsic.json",
            {"width": 8, "height": 6, "intrinsic_matrix": MATRIX},
            GivenCamera(depth_scale=5000.0),
            10,
            5000,
        ),
        ("intrinsic.json", {"width": 8, "height": 6, "intrinsic_matrix": MATRIX}, GIVEN, 12, 1000),
        ("intrinsic.json", {"stream_length_usec": 1}, GIVEN, 12, 1000),
        ("intrinsic.json", {"intrinsic_matrix": [1], "depth_scale": 500.0}, GIVEN, 12, 500),
    ],
)
def test_the_camera_is_as_each_recorder_of_open3d_writes_it(
    folder: Path, name: str, content: dict[str, object], given: GivenCamera, fx: float, scale: float
) -> None:
    """Of either name, with names of five digits, in millimetres unless it says otherwise; options win."""
    (folder / "camera_intrinsic.json").unlink()
    for n in range(3):
        (folder / "depth" / f"{n:06d}.png").rename(folder / "depth" / f"{n:05d}.png")
    (folder / name).write_text(json.dumps(content))
    source = open_source(folder, given)
    assert (source.intrinsics.fx, source.view(2).depth_scale) == (fx, scale)
    assert (source.intrinsics.width, source.numbers) == (8, range(3))
    assert source.fps == content.get("fps", 30.0)


def test_the_largest_value_is_no_depth(folder: Path) -> None:
    """Cameras write 65535 where nothing was measured; it is no wall at 65.5 m."""
    depth = np.full((6, 8), 2000, np.uint16)
    depth[:, 4:] = 65535
    Image.fromarray(depth).save(folder / "depth" / "000001.png")
    assert open_source(folder).view(1).metres().max() == 2.0


@pytest.mark.parametrize(
    ("wanted", "frames"),
    [
        (None, range(10, 20)), ("12:15", range(12, 15)), (":12", range(10, 12)), ("18:", range(18, 20)),
        *((wrong, None) for wrong in ("0:12", "12:21", "15:12", "20:", "-3:", "a:b", "12", "1:2:3", "")),
    ],
)  # fmt: skip
def test_a_range_of_frames_is_half_open_and_has_to_be_there(wanted: str | None, frames: range | None) -> None:
    """Either end may be omitted; invalid ranges are refused with a line that has the sequence's frames."""
    if frames is None:
        with refused("this sequence has frames 10:20"):
            select_frames(range(10, 20), wanted)
    else:
        assert list(select_frames(range(10, 20), wanted)) == list(frames)


def write_mat(path: Path, depth: NDArray[Any], name: str = "d_depth") -> Path:
    """A compressed MATLAB 5 file, as the data set's."""
    savemat(path, {name: depth}, do_compression=True)
    return path


def test_a_utd_file_of_one_frame_or_of_doubles_is_read_too(tmp_path: Path) -> None:
    """MATLAB drops a last axis of length one, and may keep whole numbers as doubles."""
    depth = np.random.default_rng(0).integers(0, 4000, (240, 320)).astype(np.float64)
    source = open_source(write_mat(tmp_path / "one.mat", depth))
    assert len(source) == 1
    np.testing.assert_array_equal(source.view(0).depth, depth)


@pytest.mark.parametrize(
    ("depth", "name"),
    [
        (np.zeros((240, 320, 1), np.uint16), "d_skel"),
        (np.zeros((240, 320, 0), np.uint16), "d_depth"),
        (np.full((240, 320, 1), 0.5), "d_depth"),
        (np.full((240, 320, 1), -1.0), "d_depth"),
    ],
)
def test_a_mat_file_of_something_else_is_refused(tmp_path: Path, depth: NDArray[Any], name: str) -> None:
    """A skeleton file, another shape, and numbers that are no depth."""
    with refused("no 'd_depth' "):
        open_source(write_mat(tmp_path / "x.mat", depth, name))
