"""ROS 2 as its middleware over Zenoh speaks it: keys, tokens, images, joint states, and a peer of others."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from gepf.common.camera import Intrinsics
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.sources.live_stream import LiveCamera
from gepf.coordinator.sources.ros2 import Node
from gepf.coordinator.sources.ros2_input import DepthTopic, JointTopic
from gepf.coordinator.sources.ros_images import COMPRESSED, pixels
from tests.support.processes.programs import wait_until
from tests.support.ros import CAMERA, IMAGE, camera_of, header_of, image_of

TYPES, TOPIC = get_typestore(Stores.ROS2_JAZZY).types, "/camera/depth/image_rect_raw"
TALKER = (
    "0/chatter/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
"""The key of an example in the middleware's documentation of its design."""
DEPTH = np.array([[0, 7, 65535], [1, 0, 0]], dtype=np.uint16)
RVL = bytes.fromhex("0300000002000000ff8ee113f3ffbff300000020")
"""The same, with columns and rows before it, compressed by the program of the method's inventor."""


@contextmanager
def meeting(endpoint: str) -> Iterator[tuple[Bus, Node, Node]]:
    """At a router: a bare session, a robot's node and ours."""
    with ExitStack() as stack:
        stack.enter_context(open_router([endpoint]))
        buses = [stack.enter_context(open_worker([endpoint])) for _ in range(3)]
        yield buses[0], Node(buses[1], 0), Node(buses[2], 0)


def image(node: Node, depth: NDArray[np.generic], time_s: float = 0.0, encoding: str = "16UC1") -> Any:
    """An image message."""
    return image_of(TYPES, node.header(time_s), depth, encoding)


def camera_info(node: Node) -> Any:
    """The message of a calibrated camera."""
    return camera_of(TYPES, node.header(0.0), Intrinsics(3, 2, 50.0, 51.0, 1.0, 0.5))


def test_keys_tokens_and_attachments_are_those_of_the_design(endpoint: str) -> None:
    """A message arrives on the documented key; the documented token names node, topic, type and settings."""
    heard: list[bytes] = []
    tokens: list[str] = []
    with meeting(endpoint) as (bare, robot, _):
        bare.subscribe(TALKER, lambda _, payload: heard.append(payload))
        bare.watch("@ros2_lv/0/*/0/*/MP/**", lambda token, _: tokens.append(token))
        talker = robot.advertise("/chatter", "std_msgs/msg/String")
        wait_until(lambda: talker.has_subscriber and bool(tokens))
        talker.put(robot.make("std_msgs/msg/String", "hello"))
        wait_until(lambda: bool(heard))
    assert heard == [b"\0\1\0\0" + struct.pack("<I", 6) + b"hello\0"]
    _, name, kind_and_hash = TALKER.split("/", 2)
    assert tokens[0].split("/", 5)[5] == f"MP/%/%/gepf/%{name}/{kind_and_hash}/::,10:,:,:,,"


def compressed(form: str, packed: bytes, quantisation: tuple[float, float] = (0.0, 0.0)) -> Any:
    """A message of the transport compressedDepth."""
    data = np.frombuffer(struct.pack("<iff", 0, *quantisation) + packed, np.uint8)
    return SimpleNamespace(format=form, data=data)


def png(values: NDArray[np.uint16]) -> bytes:
    """A 16-bit PNG."""
    file = BytesIO()
    Image.fromarray(values).save(file, "PNG")
    return file.getvalue()


def test_compressed_depth_is_unpacked() -> None:
    """PNG and RVL give the pixels; floats are inverse depth, a / (value - b), and NaN or 0 where none is."""
    assert np.array_equal(pixels(compressed("16UC1; compressedDepth png", png(DEPTH))), DEPTH)
    assert np.array_equal(pixels(compressed("16UC1; compressedDepth rvl", RVL)), DEPTH)
    metres = pixels(compressed("32FC1; compressedDepth png", png(DEPTH), (14.0, 5.0)))
    assert metres[0, 1] == pytest.approx(7.0)
    assert metres[1, 1] == 0.0


@pytest.mark.parametrize("cut", range(len(RVL)))
def test_damaged_rvl_is_refused(cut: int) -> None:
    """A message that is cut short, or whose runs are longer than its image, is not read beyond its end."""
    with pytest.raises(ValueError, match="its RVL"):
        pixels(compressed("16UC1; compressedDepth rvl", RVL[:cut]))
    longer = RVL[:8] + bytes([0xFF] * cut)
    with pytest.raises(ValueError, match="its RVL"):
        pixels(compressed("16UC1; compressedDepth rvl", longer))


METRES = np.array([[0.0, np.nan, 1.5], [np.inf, 2.0, -1.0]], dtype=np.float32)


@contextmanager
def listening(
    ours: Node, robot: Node, *limits: float, topic: str = TOPIC, kind: str = IMAGE, colour: bool = False
) -> Iterator[tuple[LiveFrames, list[str], Any]]:
    """Live frames of the topic, what is reported meanwhile, and a function that publishes."""
    reports, sent = list[str](), {topic: kind, "/camera/depth/camera_info": CAMERA}
    frames = LiveFrames([LiveCamera(topic)], reports.append, *limits)
    DepthTopic(ours, topic, frames, colour=colour)
    publishers = [robot.advertise(*named) for named in sent.items()]
    wait_until(lambda: all(each.has_subscriber for each in publishers) and topic in ours.topics(kind))

    def publish(message: Any, camera: Any = None) -> None:
        if camera is not None:
            publishers[1].put(camera)
        publishers[0].put(message)
        frames.wait(0.1)

    yield frames, reports, publish
    frames.end()


@pytest.mark.parametrize(
    ("encoding", "depth", "metres"),
    [
        ("16UC1", DEPTH, DEPTH % 65535 / 1000),
        ("mono16", DEPTH, DEPTH % 65535 / 1000),
        ("32FC1", METRES, [[0.0, 0.0, 1.5], [0.0, 2.0, 0.0]]),
    ],
)
def test_images_become_frames_with_exact_times(
    endpoint: str, encoding: str, depth: NDArray[np.generic], metres: Any
) -> None:
    """In metres, with their camera; the header of a result is that of its image, to the nanosecond.

    The largest value of 16 bits is no depth.
    """
    with meeting(endpoint) as (_, robot, ours), listening(ours, robot) as (frames, _, publish):
        robot.began_ns, robot.frame_id = 1_764_000_000_123_456_789, "optical"
        for time_s in (0.0, 1 / 3, 5000 / 3):
            before, message = frames.counts["received"], image(robot, depth, time_s, encoding)
            while frames.counts["received"] == before:  # the camera may come after the image
                publish(message, camera_info(robot))
            frame = next(iter(frames))
            assert frame.time_s == pytest.approx(time_s, abs=1e-9)
            assert ours.header(frame.time_s) == message.header
            assert np.allclose(frame.views[0].metres(), metres, atol=1e-4)
            assert (frame.views[0].intrinsics.fx, frame.views[0].intrinsics.cy) == (50.0, 0.5)


def test_images_without_stamps_have_the_times_of_their_reception(endpoint: str) -> None:
    """No image is rejected, times rise, and one line says so."""
    with meeting(endpoint) as (_, robot, ours), listening(ours, robot) as (frames, reports, publish):
        message, times = image_of(TYPES, header_of(TYPES), DEPTH), list[float]()
        while len(times) < 4:
            before = frames.counts["received"]
            publish(message, camera_info(robot))
            if frames.counts["received"] > before:
                times.append(next(iter(frames)).time_s)
        assert frames.counts["rejected"] == 0
        assert all(late > early for early, late in pairwise(times))
        assert [line for line in reports if "no stamps" in line] == [
            f"images on {TOPIC} have no stamps; they get the time of reception"
        ]


@pytest.mark.parametrize("name", ["image_raw", "image_rect"])
def test_distortion_of_a_live_camera_is_undone(endpoint: str, name: str) -> None:
    """A frame has the depth of the distorted pixels, unless the topic is of rectified images."""
    camera, ramp = Intrinsics(32, 24, 20.0, 20.0, 15.5, 11.5), np.arange(32 * 24, dtype=np.uint16) + 1000
    depth, coefficients = ramp.reshape(24, 32), (0.1, -0.05, 0.001, 0.002, 0.01)
    topic = f"/camera/depth/{name}"
    with meeting(endpoint) as (_, robot, ours), listening(ours, robot, topic=topic) as (frames, _, publish):
        info = camera_of(TYPES, robot.header(1.0), camera, coefficients)
        while not frames.counts["received"]:
            publish(image(robot, depth, 1.0), info)
        expected = depth if name == "image_rect" else Lens(camera, coefficients).undistort(depth)
        received = next(iter(frames)).views[0].depth
        np.testing.assert_array_equal(received, expected)
        assert np.array_equal(received, depth) == (name == "image_rect")


def test_compressed_live_depth_is_read_unless_it_is_jpeg(endpoint: str) -> None:
    """PNG of the usual transport gives the pixels; a JPEG is refused by name, with what to use."""
    jpeg, topic = BytesIO(), f"{TOPIC}/compressed"
    Image.fromarray(DEPTH.astype(np.uint8)).save(jpeg, "JPEG")
    with (
        meeting(endpoint) as (_, robot, ours),
        listening(ours, robot, topic=topic, kind=COMPRESSED) as (frames, reports, publish),
    ):
        make = TYPES[COMPRESSED]
        for form, content in (("16UC1; jpeg compressed mono8", jpeg.getvalue()), ("16UC1; png", png(DEPTH))):
            message = make(robot.header(1.0), form, np.frombuffer(content, np.uint8))
            while not (frames.counts["received"] if "png" in form else reports):
                publish(message, camera_info(robot))
        np.testing.assert_array_equal(next(iter(frames)).views[0].depth, DEPTH % 65535)
        assert "it is depth as JPEG (16UC1; jpeg compressed mono8), which destroys it; use" in reports[0]


@pytest.mark.parametrize("frame_id", ["optical", "other"])
@pytest.mark.parametrize("name", ["/camera/color/image_raw", "/camera/color/image_raw/compressed"])
def test_colour_of_the_camera_joins_its_depth(endpoint: str, name: str, frame_id: str) -> None:
    """Raw or compressed, if it has come before. That of another frame is not used, and a line says so."""
    values = np.full((4, 6, 3), (200, 40, 10), np.uint8)
    with meeting(endpoint) as (_, robot, ours):
        robot.began_ns, robot.frame_id = 1_764_000_000_123_456_789, "optical"
        is_raw, sent = name.endswith("raw"), 0
        pictures = robot.advertise(name, IMAGE if is_raw else COMPRESSED)
        infrared = robot.advertise("/camera/infra1/image_raw", IMAGE)
        wait_until(lambda: bool(ours.topics(IMAGE, COMPRESSED)))
        with listening(ours, robot, topic=TOPIC, colour=True) as (frames, reports, publish):
            found = None
            while found is None and not reports:
                sent += 1
                header = robot.header(sent / 30)
                header.frame_id = frame_id
                packed = BytesIO()
                Image.fromarray(values).save(packed, "PNG")
                data = np.frombuffer(packed.getvalue(), np.uint8)
                ordered = np.ascontiguousarray(values[:, :, ::-1])
                message: Any = (
                    image_of(TYPES, header, ordered.reshape(4, 18), "bgr8")
                    if is_raw
                    else TYPES[COMPRESSED](header, "bgr8; png compressed bgr8", data)
                )
                if is_raw:
                    message.width = 6
                pictures.put(message)
                before = frames.counts["received"]
                publish(image(robot, DEPTH, sent / 30), camera_info(robot))
                if frames.counts["received"] > before:
                    found = next(iter(frames)).views[0].colours  # None before its topic is known
            assert not infrared.has_subscriber
            if frame_id == "optical":
                assert found is not None
                assert np.array_equal(found, values)
            else:
                assert found is None
                (line,) = reports
                assert line.startswith(
                    f"colour is not used, because it is in the frame 'other', not in that of {TOPIC}"
                )


def test_a_topic_that_nobody_publishes_is_named_beside_those_that_exist(endpoint: str) -> None:
    """When none came for a while, and at the end of the run."""
    with meeting(endpoint) as (_, robot, ours):
        robot.advertise("/head/depth", IMAGE)
        wait_until(lambda: ours.topics(IMAGE) == ["/head/depth"])
        reports = list[str]()
        frames = LiveFrames([LiveCamera(TOPIC)], reports.append, 0.1, idle=0.3)
        DepthTopic(ours, TOPIC, frames)
        assert list(frames) == []
        why = "which nobody publishes; images are on /head/depth"
        assert reports[0] == f"no frame comes on {TOPIC}, {why}; waiting for one"
        assert reports[1] == f"no frame came on {TOPIC} for 0.3 s, {why}; ending"


def test_images_without_a_camera_are_left_out(endpoint: str) -> None:
    """The line names the topic on which the camera was expected."""
    with (
        meeting(endpoint) as (_, robot, ours),
        listening(ours, robot, 0.1, 0.3) as (frames, reports, publish),
    ):
        publish(image(robot, DEPTH))
        assert list(frames) == []
        assert "because no camera_info comes on /camera/depth/camera_info; waiting" in reports[0]


@pytest.mark.parametrize(
    ("depth", "encoding", "words"),
    [
        (DEPTH, "rgb8", "its encoding is rgb8, not mono16, 16UC1, 32FC1"),
        (DEPTH.T, "16UC1", "it is 2x3, but its camera_info says 3x2"),
        (DEPTH[:1], "mono16", "it is 3x1, but its camera_info says 3x2"),
    ],
)
def test_images_that_are_no_depth_of_their_camera_are_refused(
    endpoint: str, depth: NDArray[np.generic], encoding: str, words: str
) -> None:
    """The line says what is wrong with them."""
    with meeting(endpoint) as (_, robot, ours), listening(ours, robot) as (frames, reports, publish):
        while not reports:
            publish(image(robot, depth, encoding=encoding), camera_info(robot))
        assert reports == [f"a message on {TOPIC} is malformed: {words}"]
        assert frames.counts["received"] == 0


def test_joint_states_are_interpolated_at_the_times_of_frames(endpoint: str) -> None:
    """Between two states; unknown after the last. States of other joints, as a gripper's, are left out."""
    with meeting(endpoint) as (_, robot, ours):
        states = robot.advertise("/joint_states", "sensor_msgs/msg/JointState")
        topic, reports = JointTopic("/joint_states"), list[str]()
        topic.listen(ours, ["root_tx", "elbow"], reports.append)
        wait_until(lambda: states.has_subscriber)
        robot.began_ns = ours.began_ns = 1_764_000_000_000_000_000
        nothing = np.empty(0)
        for time_s, name, value in ((0.0, "finger", 9.0), (0.0, "elbow", 1.0), (0.1, "elbow", 2.0)):
            position = np.array([value])
            states.put(
                robot.make(
                    "sensor_msgs/msg/JointState", robot.header(time_s), [name], position, nothing, nothing
                )
            )
        wait_until(lambda: topic.names == ("elbow",) and bool(np.isfinite(topic.at(0.05)).all()))
        assert topic.at(0.025) == pytest.approx([1.25])
        assert np.isnan(topic.at(0.2)).all()
        assert len(reports) == 1
        assert "unknown degree of freedom 'finger'" in reports[0]
