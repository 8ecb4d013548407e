"""Bags as people record them: times, order, encodings, cameras, storage; ROS 1 and ROS 2."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources import Source, find_format, open_source
from gepf.coordinator.sources.camera import GivenCamera
from gepf.coordinator.sources.joint_states import read_joint_states
from gepf.coordinator.sources.lens import Lens
from tests.support.bags import (
    EPOCH_NS,
    INFO,
    SMALL,
    TOPIC,
    Message,
    camera,
    compressed,
    encoded,
    images,
    numbered,
    types_of,
    write,
)
from tests.support.refusals import refused
from tests.support.ros import header_of

BAGS = ["walk.bag", "walk"]
STEP_NS = 33_000_000
FRAMES = 12
STAMPS = [EPOCH_NS + n * STEP_NS for n in range(FRAMES)]
BURSTS = [EPOCH_NS + 10**9 + n // 4 * 4 * STEP_NS + n % 4 * 300_000 for n in range(FRAMES)]
METRES = (numbered(3) / 1000.0).astype(np.float32)
TIES = [EPOCH_NS + n // 3 * 3 * STEP_NS for n in range(FRAMES)]


def order(source: Source) -> list[int]:
    """Which image each frame is."""
    return [int(frame.views[0].depth[0, 0]) - 1000 for frame in source]


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("records", [STAMPS, BURSTS, TIES], ids=["even", "bursts", "ties"])
def test_times_are_the_stamps_of_the_images(tmp_path: Path, name: str, records: list[int]) -> None:
    """Whenever messages were recorded, also several at once; every image is there once."""
    path = tmp_path / name
    source = open_source(write(path, [camera(path), *images(path, records, STAMPS)]))
    assert order(source) == [*range(FRAMES)]
    assert source.times_s == pytest.approx([n * 0.033 for n in range(FRAMES)], abs=1e-9)
    assert source.fps == pytest.approx(1 / 0.033)


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize(
    ("records", "told"), [(STAMPS, False), (BURSTS, True), (TIES, True)], ids=["even", "bursts", "ties"]
)
def test_images_without_stamps_have_their_order_and_a_plausible_rate(
    tmp_path: Path, name: str, records: list[int], told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Times of recording if they are plausible; else evenly spaced times, which one line tells."""
    path = tmp_path / name
    source = open_source(write(path, [camera(path), *images(path, records)]))
    assert order(source) == [*range(FRAMES)]
    assert source.fps == pytest.approx(1 / 0.033, rel=0.4)
    assert ("evenly spaced times are assumed" in caplog.text) == told


def test_images_that_come_late_are_in_the_order_of_their_stamps(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One that overtook another, and one that came twice, which is left out with a line."""
    path = tmp_path / "walk"
    stamps = [STAMPS[0], STAMPS[2], STAMPS[1], STAMPS[3], STAMPS[3]]
    source = open_source(write(path, [camera(path), *images(path, STAMPS[:5], stamps)]))
    assert order(source) == [0, 2, 1, 3]
    assert source.times_s == pytest.approx([0.0, 0.033, 0.066, 0.099])
    assert "1 messages that repeat" in caplog.text


@pytest.mark.parametrize(
    ("form", "pictures"),
    [
        ("16UC1; png compressed ", [encoded(each, "PNG") for each in numbered(3)]),
        ("16UC1; tiff compressed ", [encoded(each, "TIFF") for each in numbered(3)]),
        ("32FC1; tiff compressed ", [encoded(each, "TIFF") for each in METRES]),
        ("png", [encoded(each, "PNG") for each in numbered(3)]),
        ("tiff", [encoded(each, "TIFF") for each in METRES]),
    ],
)
def test_compressed_depth_without_loss_is_read(tmp_path: Path, form: str, pictures: list[bytes]) -> None:
    """PNG and TIFF of the usual transport, whole millimetres or metres, with or without the encoding."""
    path = tmp_path / "walk"
    messages = compressed(path, form, pictures, f"{TOPIC}/compressed", STEP_NS)
    source = open_source(write(path, [camera(path), *messages]))
    assert np.allclose([frame.views[0].metres() for frame in source], numbered(3) / 1000.0, atol=2e-4)


def test_depth_as_jpeg_is_refused_by_name_and_not_preferred(tmp_path: Path) -> None:
    """A bag with it alone names the topic and what to record; beside another topic that one is read."""
    jpeg = encoded(numbered(3)[0].astype(np.uint8), "JPEG")
    for n, form in enumerate(("16UC1; jpeg compressed mono8", "jpeg")):
        path = tmp_path / f"lossy{n}"
        lossy = compressed(path, form, [jpeg] * 3, "/a/depth/compressed", STEP_NS)
        write(path, [camera(path), *lossy])
        if n == 0:
            with refused("/a/depth/compressed holds depth as JPEG, which destroys it; record"):
                open_source(path)
        path = tmp_path / f"both{n}"
        write(path, [camera(path), *lossy, *images(path, STAMPS[:3], STAMPS[:3])])
        assert order(open_source(path)) == [0, 1, 2]


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("alone", [True, False])
def test_a_storage_file_without_its_folder_or_metadata_is_a_bag(
    tmp_path: Path, plugin: StoragePlugin, alone: bool
) -> None:
    """A lone `.db3` or `.mcap`, and a folder whose recorder was killed before it wrote metadata.yaml."""
    path = tmp_path / "walk"
    write(path, [camera(path), *images(path, STAMPS, STAMPS)], plugin)
    (path / "metadata.yaml").unlink()
    (file,) = path.iterdir()
    given = file if alone else path
    assert find_format(given).name == "ROS 1 or RealSense .bag, ROS 2 .mcap, .db3 or folder"
    assert order(open_source(given)) == [*range(FRAMES)]


def test_a_bag_without_an_index_is_read_as_far_as_it_goes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """ROS 1: all images of the chunks that were written, with a line; also under its name while recorded."""
    path = tmp_path / "walk.bag"
    write(path, [camera(path), *images(path, STAMPS, STAMPS)])
    content = path.read_bytes()
    at = content.index(b"index_pos=") + len(b"index_pos=")
    (end,) = struct.unpack_from("<Q", content, at)
    path.write_bytes(content[:at] + bytes(8) + content[at + 8 : end])
    assert order(open_source(path)) == [*range(FRAMES)]
    assert "was not closed by its recorder; it is read as far as it goes" in caplog.text
    active = path.rename(tmp_path / "walk.bag.active")
    assert order(open_source(active)) == [*range(FRAMES)]


def test_an_mcap_file_that_is_cut_off_is_read_as_far_as_it_goes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As when the recorder is killed: all images of complete records, with a line."""
    path = tmp_path / "walk"
    write(path, [camera(path), *images(path, STAMPS, STAMPS)], StoragePlugin.MCAP)
    (file,) = path.glob("*.mcap")
    whole = file.read_bytes()
    (path / "metadata.yaml").unlink()
    footer = 37
    (summary,) = struct.unpack_from("<Q", whole, len(whole) - footer + 9)
    file.write_bytes(whole[: summary - 5])
    assert order(open_source(path)) == [*range(FRAMES)]
    assert "was not closed by its recorder" in caplog.text


@pytest.mark.parametrize("name", BAGS)
def test_distortion_in_camera_info_is_undone(tmp_path: Path, name: str) -> None:
    """Every frame has the depth of the distorted pixels, as `Lens` moves them; rectified ones stay."""
    path, coefficients = tmp_path / name, (0.3, -0.1, 0.01, 0.02, 0.05)
    lens = Lens(SMALL, coefficients)
    source = open_source(write(path, [camera(path, distortion=coefficients), *images(path, STAMPS, STAMPS)]))
    assert source.intrinsics == SMALL
    for depth, frame in zip(numbered(FRAMES), source, strict=True):
        np.testing.assert_array_equal(frame.views[0].depth, lens.undistort(depth))
    rect = tmp_path / f"rect_{name}"
    messages = images(rect, STAMPS, STAMPS, "/camera/depth/image_rect")
    source = open_source(write(rect, [camera(rect, distortion=coefficients), *messages]))
    np.testing.assert_array_equal([frame.views[0].depth for frame in source], numbered(FRAMES))


def test_the_camera_of_another_camera_is_not_taken(tmp_path: Path) -> None:
    """Only the colour camera's, of the same size: the line says what to record, and the values to confirm."""
    path = tmp_path / "walk"
    write(path, [camera(path, "/camera/color/camera_info", "color"), *images(path, STAMPS, STAMPS)])
    with refused(r"/camera/color/camera_info is of another camera than /camera/depth/image_raw; record"):
        open_source(path)
    with pytest.raises(InputError, match=r"\(50,51,7\.5,5\.5 are those of /camera/color/camera_info\)"):
        open_source(path)
    given = GivenCamera((50.0, 51.0, 7.5, 5.5))
    assert open_source(path, given).intrinsics == SMALL


@pytest.mark.parametrize(
    ("topic", "frame", "info", "info_frame"),
    [
        (TOPIC, "depth", INFO, ""),
        ("/camera/depth_registered/image", "color", "/camera/color/camera_info", "color"),
        ("/kinect2/qhd/image_depth_rect", "rgb", "/kinect2/qhd/camera_info", "rgb"),
        ("/device_0/sensor_0/Depth_0/image/data", "0", "/device_0/sensor_0/Depth_0/info/camera_info", ""),
        ("/camera/depth/image", "d", "/camera/camera_info", ""),
    ],
)
def test_the_camera_is_that_of_the_namespace_or_the_frame(
    tmp_path: Path, topic: str, frame: str, info: str, info_frame: str
) -> None:
    """As drivers name them, though another camera's is there, too."""
    path = tmp_path / "walk"
    other = camera(path, "/other/camera_info", "other")
    other.content.k[0] = 77.0
    messages = [camera(path, info, info_frame), *images(path, STAMPS, STAMPS, topic, frame)]
    assert open_source(write(path, messages)).intrinsics == Intrinsics(16, 12, 50.0, 51.0, 7.5, 5.5)


def test_joint_states_have_the_clock_of_the_images(tmp_path: Path) -> None:
    """Both by stamps; if one has none, both by their recording."""
    for name, stamped in (("stamps", True), ("records", False)):
        path = tmp_path / name
        make = types_of(path).types
        late_ns = 500_000_000  # of recording
        states = []
        for n in range(4):
            stamp = divmod(STAMPS[n], 10**9) if stamped else (0, 0)
            values = np.array([0.1 * n]), np.empty(0), np.empty(0)
            content = make["sensor_msgs/msg/JointState"](header_of(make, "", *stamp), ["elbow"], *values)
            states.append(Message("/joint_states", STAMPS[n] + (late_ns if stamped else 0), content))
        write(path, [camera(path), *images(path, STAMPS, STAMPS), *states])
        assert read_joint_states(path).at(0.033) == pytest.approx([0.1])


COLOUR, LATE_NS = "/camera/color/image_raw", 4_000_000


def picture(number: int) -> NDArray[np.uint8]:
    """Of twice the depth's size; red tells which it is, blue the column."""
    values = np.full((2 * SMALL.height, 2 * SMALL.width, 3), (10 * number, 50, 0), np.uint8)
    values[:, :, 2] = 3 * np.arange(2 * SMALL.width)
    return values


def pictures(path: Path, frame_id: str, encoding: str, kept: slice = slice(None)) -> list[Message]:
    """Colour, a little later than depth."""
    make, messages = types_of(path).types, []
    for n, stamp in [*enumerate(STAMPS)][kept]:
        header = header_of(make, frame_id, *divmod(stamp + LATE_NS, 1_000_000_000))
        values = picture(n)
        if encoding in ("rgb8; jpeg compressed bgr8", "png"):
            data = encoded(values, "JPEG" if "jpeg" in encoding else "PNG")
            kind = make["sensor_msgs/msg/CompressedImage"]
            content = kind(header, encoding, np.frombuffer(data, np.uint8))
        else:
            ordered = np.ascontiguousarray(values if encoding == "rgb8" else values[:, :, ::-1])
            if encoding == "bgra8":
                ordered = np.pad(ordered, ((0, 0), (0, 0), (0, 1)))
            content = make["sensor_msgs/msg/Image"](
                header, *ordered.shape[:2], encoding, 0, ordered[0].nbytes, ordered.ravel()
            )
        messages.append(Message(COLOUR, stamp + LATE_NS, content))
    return messages


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8", "rgb8; jpeg compressed bgr8", "png"])
def test_frames_have_the_colour_of_the_same_camera(tmp_path: Path, name: str, encoding: str) -> None:
    """Of the nearest image in time; none where it is missing, and none if it is not asked for."""
    path = tmp_path / name
    write(
        path, [camera(path), *images(path, STAMPS, STAMPS), *pictures(path, "depth", encoding, slice(2, 9))]
    )
    assert all(frame.views[0].colours is None for frame in open_source(path))
    frames = [*open_source(path, color=True)]
    assert [frame.views[0].colours is not None for frame in frames] == [2 <= n < 9 for n in range(FRAMES)]
    for n, frame in [*enumerate(frames)][2:9]:
        assert frame.views[0].colours is not None
        assert frame.views[0].colours.shape == (2 * SMALL.height, 2 * SMALL.width, 3)
        tolerance = 12 if "jpeg" in encoding else 0
        assert np.abs(frame.views[0].colours[0, -1].astype(int) - (10 * n, 50, 93)).max() <= tolerance
    mirrored = open_source(path, GivenCamera(mirrored=True), color=True).view(3).colours
    assert mirrored is not None
    assert np.array_equal(mirrored, frames[3].views[0].colours[:, ::-1])


def test_colour_loses_the_distortion_that_depth_loses(tmp_path: Path) -> None:
    """Both images of the aligned camera are bent by its lens; a pixel of both shows the same place."""
    path, bent = tmp_path / "walk", (8.0, 0.0, 0.0, 0.0, 0.0)
    write(
        path, [camera(path, distortion=bent), *images(path, STAMPS, STAMPS), *pictures(path, "depth", "rgb8")]
    )
    colours = open_source(path, color=True).view(1).colours
    assert colours is not None
    twice = Intrinsics(32, 24, 100.0, 102.0, 15.5, 11.5)
    straight = [Lens(twice, bent).undistort(channel) for channel in np.moveaxis(picture(1), 2, 0)]
    assert np.array_equal(colours, np.stack(straight, axis=-1))
    assert not np.array_equal(colours, picture(1))


@pytest.mark.parametrize("name", BAGS)
def test_colour_of_another_camera_is_not_used(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    """That is said in a line; infrared images are no colour, and nothing is said of them."""
    path = tmp_path / name
    write(path, [camera(path), *images(path, STAMPS, STAMPS), *pictures(path, "color", "rgb8")])
    assert all(frame.views[0].colours is None for frame in open_source(path, color=True))
    assert f"colour on {COLOUR} is not used, as it is from another camera than depth" in caplog.text
