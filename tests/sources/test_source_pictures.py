"""Folders of images with gaps and their own times, `.npy`, ROS 2 bags, options about the camera."""

from __future__ import annotations

import logging
import tracemalloc
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.camera import GivenCamera, parse_camera, write_camera
from gepf.coordinator.sources.source import select_frames
from tests.support.ros import camera_of, header_of, image_of

SMALL = Intrinsics(16, 12, 50.0, 51.0, 7.5, 5.5)
LENS = GivenCamera((50.0, 51.0, 7.5, 5.5))
SIZE = (12, 16)  # rows, columns


def depth(frames: int) -> NDArray[np.uint16]:
    """Frames (F, H, W) in millimetres, each with another first pixel."""
    values = np.full((frames, *SIZE), 2000, np.uint16)
    values[:, 0, 0] = 1000 + np.arange(frames)
    return values


def write_pictures(folder: Path, names: list[str]) -> Path:
    """A folder of PNG with these names."""
    folder.mkdir(parents=True)
    for name, values in zip(names, depth(len(names)), strict=True):
        Image.fromarray(values).save(folder / name)
    return folder


def taken(path: Path, given: GivenCamera = LENS) -> tuple[list[int], list[float]]:
    """Numbers and times of all frames, in order."""
    source = open_source(path, given)
    frames = list(source)
    assert [frame.views[0].depth[0, 0] for frame in frames] == [1000 + n for n in range(len(frames))]
    return [frame.number for frame in frames], [round(frame.time_s, 6) for frame in frames]


def test_missing_frames_keep_their_numbers_and_times(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Frames 3 and 6 are 0.1 s apart though two are missing in between, which is reported."""
    write_pictures(tmp_path / "seq" / "depth", ["000002.png", "000003.png", "000006.png"])
    write_camera(tmp_path / "seq" / "camera_intrinsic.json", SMALL, 1000.0)
    assert taken(tmp_path / "seq", GivenCamera()) == ([2, 3, 6], [0.066667, 0.1, 0.2])
    assert "2 of 5 frames are missing, frame 4 first; the others keep their times" in caplog.text
    numbers = open_source(tmp_path / "seq").numbers
    assert list(select_frames(numbers, "3:7")) == [3, 6]
    with pytest.raises(InputError, match="is out of range or in a gap"):
        select_frames(numbers, "4:6")


@pytest.mark.parametrize(
    ("names", "numbers", "times"),
    [
        (["1305031453.374112.png", "1305031453.407388.png"], [0, 1], [0.0, 0.033276]),
        (["d_1700000000000000.png", "d_1700000000033000.png"], [0, 1], [0.0, 0.033]),
        (["1700000000000000000.png", "1700000000066000000.png"], [0, 1], [0.0, 0.066]),
        (["depth_9.png", "depth_10.png", "depth_12.png"], [9, 10, 12], [0.3, 0.333333, 0.4]),
        (
            ["1700000000_966666666.png", "1700000001_0.png", "1700000001_33333333.png"],
            [0, 1, 2],
            [0.0, 0.033333, 0.066667],
        ),
        (["12_900000.png", "12_933333.png", "13_066667.png"], [0, 1, 2], [0.0, 0.033333, 0.166667]),
        (
            ["20240131_235959_966667.png", "20240201_000000_000000.png", "20240201_000000_033333.png"],
            [0, 1, 2],
            [0.0, 0.033333, 0.066666],
        ),
        (["2024-01-31_14-25-59-950.png", "2024-01-31_14-26-00-010.png"], [0, 1], [0.0, 0.06]),
        (["cam1_7_1700000000100.png", "cam1_8_1700000000133.png"], [0, 1], [0.0, 0.033]),
        (["1700000000100_9.png", "1700000000133_10.png"], [0, 1], [0.0, 0.033]),
        (
            ["0.png", "33.png", "67.png", "100.png", "133.png"],
            [0, 1, 2, 3, 4],
            [0.0, 0.033, 0.067, 0.1, 0.133],
        ),
        (["0000.png", "0010.png", "0020.png", "0030.png"], [0, 10, 20, 30], [0.0, 0.333333, 0.666667, 1.0]),
        (["take1_8.png", "take1_9.png", "take2_1.png"], [0, 1, 2], [0.0, 0.033333, 0.066667]),
    ],
)
def test_names_are_times_or_numbers(
    tmp_path: Path, names: list[str], numbers: list[int], times: list[float]
) -> None:
    """Of all units, with fractions, dates or an index; numbers close together count. No depth/ is needed.

    Files are in the order of all their numbers, whatever the width of the fractions.
    """
    assert taken(write_pictures(tmp_path / "seq", names)) == (numbers, times)


@pytest.mark.parametrize(
    ("lines", "times"),
    [
        ("10.0\n10.04\n10.2\n", [0.0, 0.04, 0.2]),
        ("# time name\n10.0 2.png\n10.2 5.png\n10.04 3.png\n", [0.0, 0.04, 0.2]),
        ("depth/5.png 10.2\ndepth/3.png 10.04\ndepth/2.png 10.0\n", [0.0, 0.04, 0.2]),
        ("10.0 2.png\n10.04 3.png\n", [0.0, 0.04]),
        ("1700000000000\n1700000000040\n1700000000200\n", [0.0, 0.04, 0.2]),
        ("0\n40000\n200000\n", [0.0, 0.04, 0.2]),
        ("0.0\n40.0\n200.0\n", [0.0, 0.04, 0.2]),
        ("0 1700000000.00\n1 1700000000.04\n2 1700000000.20\n", [0.0, 0.04, 0.2]),
        ("1700000000 960000000\n1700000001 0\n1700000001 160000000\n", [0.0, 0.04, 0.2]),
        ("index,timestamp_ms,file\n0,5000,2.png\n1,5040,3.png\n2,5200,5.png\n", [0.0, 0.04, 0.2]),
        ("2024-01-31 23:59:59.960\n2024-02-01 00:00:00.000\n2024-02-01 00:00:00.160\n", [0.0, 0.04, 0.2]),
        ("\ufeff10.0\r\n10.04\r\n10.2\r\n", [0.0, 0.04, 0.2]),
    ],
)
def test_a_text_file_gives_times(tmp_path: Path, lines: str, times: list[float]) -> None:
    """One per line, or with the image's name and an index; some images may be omitted.

    In seconds, or in another unit if frames then come at a plausible rate; as dates; with a byte order mark.
    """
    write_pictures(tmp_path / "seq" / "depth", ["2.png", "3.png", "5.png"])
    (tmp_path / "seq" / "timestamps.txt").write_text(lines)
    assert taken(tmp_path / "seq") == ([2, 3, 5][: len(times)], times)
    assert open_source(tmp_path / "seq", LENS).fps == pytest.approx(1.0 / np.median(np.diff(times)))


def test_units_that_are_assumed_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One line names the file and the unit; seconds need none."""
    write_pictures(tmp_path / "seq" / "depth", ["2.png", "3.png", "5.png"])
    for lines, says in (("10.0\n10.04\n10.2\n", ""), ("10\n50\n210\n", "times are read as milliseconds")):
        caplog.clear()
        (tmp_path / "seq" / "timestamps.txt").write_text(lines)
        taken(tmp_path / "seq")
        assert says in caplog.text
        assert sum("times are read" in line for line in caplog.messages) == bool(says)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks_are_passed_over(tmp_path: Path, encoding: str) -> None:
    """Windows' editors write camera files and times with one."""
    write_pictures(tmp_path / "seq" / "depth", ["2.png", "3.png"])
    write_camera(camera := tmp_path / "seq" / "camera_intrinsic.json", SMALL, 1000.0)
    camera.write_text(camera.read_text(), encoding=encoding)
    (tmp_path / "seq" / "timestamps.txt").write_text("10.0\n10.04\n", encoding=encoding)
    assert taken(tmp_path / "seq", GivenCamera()) == ([2, 3], [0.0, 0.04])
    assert open_source(tmp_path / "seq").intrinsics == SMALL


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("1\n2\n", r"timestamps\.txt has 2 times for 3 pictures; write one line for each"),
        ("1\n2\nsoon\n", "write times in seconds"),
        ("1\n3\n2\n", "frame 2 is not later than the last"),
    ],
)
def test_wrong_times_are_one_line(tmp_path: Path, lines: str, says: str) -> None:
    """The line names the file and what is wrong with it."""
    write_pictures(tmp_path / "seq" / "depth", ["2.png", "3.png", "5.png"])
    (tmp_path / "seq" / "timestamps.txt").write_text(lines)
    with pytest.raises(InputError, match=says):
        open_source(tmp_path / "seq", LENS)


def test_an_unknown_camera_is_asked_for(tmp_path: Path) -> None:
    """Without a camera file the line says what to write; of an .npy, which option to give."""
    write_pictures(tmp_path / "seq", ["0.png"])
    with pytest.raises(InputError, match=r"camera_intrinsic\.json; add --intrinsics fx,fy,cx,cy"):
        open_source(tmp_path / "seq")
    np.save(tmp_path / "depth.npy", depth(2))
    with pytest.raises(InputError, match="add --intrinsics fx,fy,cx,cy"):
        open_source(tmp_path / "depth.npy")


@pytest.mark.parametrize(
    ("convert", "scale", "units"),
    [
        (lambda d: d, None, "millimetres as whole numbers"),
        (lambda d: (d / 1000.0).astype(np.float32), None, "metres"),
        (lambda d: d.astype(np.float32), None, "millimetres as floats"),
        (lambda d: d.astype(np.float64) * 10.0, 10_000.0, "tenths of millimetres, given"),
    ],
)
def test_an_array_file_is_metres_whatever_it_holds(
    tmp_path: Path,
    convert: Callable[[Any], Any],
    scale: float | None,
    units: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Whole millimetres, metres, and millimetres as floats, which is reported."""
    np.save(tmp_path / "depth.npy", convert(depth(2)))
    with caplog.at_level(logging.WARNING):
        source = open_source(tmp_path / "depth.npy", GivenCamera(LENS.intrinsics, scale))
    assert np.allclose(source.view(1).metres(), depth(2)[1] / 1000.0, atol=1e-3)
    assert source.intrinsics.fy == 51.0
    assert ("is interpreted as millimetres" in caplog.text) == (units == "millimetres as floats")


def test_an_array_file_is_read_frame_by_frame(tmp_path: Path) -> None:
    """Reading all of it needs a small part of its size, as recordings are larger than memory."""
    shape, path = (300, 120, 160), tmp_path / "depth.npy"
    file = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=shape)
    file[:] = 2.0
    del file
    tracemalloc.start()
    assert all(frame.views[0].metres().min() == 2.0 for frame in open_source(path, LENS))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.2 * path.stat().st_size


def write_ros2(path: Path, encoding: str = "16UC1", kind: str = "sensor_msgs/msg/Image") -> Path:
    """A ROS 2 bag with three depth images, 40 ms and then 100 ms apart, and their camera_info."""
    types: Any = get_typestore(Stores.ROS2_HUMBLE)
    make, header = types.types, header_of(types.types)
    info = camera_of(make, header, SMALL)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        cameras = bag.add_connection("/camera/depth/camera_info", info.__msgtype__, typestore=types)
        bag.write(cameras, 1, types.serialize_cdr(info, info.__msgtype__))
        images = bag.add_connection("/camera/depth/image", kind, typestore=types)
        for values, time_ms in zip(depth(3), (5000, 5040, 5140), strict=True):
            data = (values / np.float32(1000)).astype("<f4") if encoding == "32FC1" else values.astype("<u2")
            if kind.endswith("CompressedImage"):
                png = BytesIO()
                Image.fromarray(values.astype(np.uint16)).save(png, "PNG")
                image = make[kind](
                    header, "16UC1; compressedDepth png", np.frombuffer(bytes(12) + png.getvalue(), np.uint8)
                )
            else:
                image = image_of(make, header, data, encoding)
            bag.write(images, time_ms * 1_000_000, types.serialize_cdr(image, kind))
    return path


@pytest.mark.parametrize(
    ("encoding", "kind"), [("16UC1", "Image"), ("32FC1", "Image"), ("16UC1", "CompressedImage")]
)
def test_a_ros_2_bag_round_trip(tmp_path: Path, encoding: str, kind: str) -> None:
    """Depth in millimetres, as floats or compressed, camera and real time come back as they were written."""
    source = open_source(write_ros2(tmp_path / "bag", encoding, f"sensor_msgs/msg/{kind}"))
    frames = list(source)
    assert [round(frame.time_s, 6) for frame in frames] == [0.0, 0.04, 0.14]
    assert np.allclose([frame.views[0].metres() for frame in frames], depth(3) / 1000.0, atol=1e-4)
    camera = source.intrinsics
    assert (camera.width, camera.height, camera.fx, camera.cy) == (16, 12, 50.0, 5.5)


@pytest.mark.parametrize(
    ("intrinsics", "says"),
    [
        ("500,500,320", "give four numbers"),
        ("500,-1,320,240", "positive fx, fy"),
        ("a,b,c,d", "give four numbers"),
    ],
)
def test_what_is_given_makes_sense(intrinsics: str, says: str) -> None:
    """Options about the camera are checked before anything is read."""
    with pytest.raises(InputError, match=says):
        parse_camera(intrinsics, None)
