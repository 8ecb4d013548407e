"""A ROS 1 or ROS 2 bag with depth images and their camera_info.

The `.bag` files of Intel RealSense cameras are such bags and specify their units of depth. Other bags hold
millimetres as 16-bit images, or metres as floats, compressed or not.
"""

from __future__ import annotations

from itertools import takewhile
from operator import eq
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gepf.common.errors import InputError
from gepf.coordinator.sources.bag import Bag
from gepf.coordinator.sources.camera import MILLIMETRES, GivenCamera
from gepf.coordinator.sources.clock import SECOND_NS
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.ros_camera import CAMERA, is_camera_of, lens_in
from gepf.coordinator.sources.ros_colour import colours_in
from gepf.coordinator.sources.ros_images import (
    COMPRESSED,
    ENCODINGS,
    FLOATS,
    IMAGE,
    PICTURES,
    TRANSPORT,
    encoding_of,
    is_jpeg,
    pixels,
)
from gepf.coordinator.sources.source import Source, rate_of

NUMBER = "std_msgs/msg/Float32"


def read_ros_bag(path: Path, given: GivenCamera) -> Source:
    """Read the depth images of a bag, numbered from 0 in the order of their stamps; times are from 0."""
    bag = Bag(path)
    topic = depth_topic(bag)
    clock = bag.clock(topic)
    first = bag.message(topic, int(clock.places[0]))
    floats = encoding_of(first) == FLOATS
    if given.intrinsics is not None:
        lens = Lens(given.camera(bag.guarded(lambda: pixels(first)).shape, path))
    else:
        lens = camera_of(bag, topic, first)

    def read(place: int) -> NDArray[np.generic]:
        image = bag.message(topic, int(clock.places[place]))
        depth = bag.guarded(lambda: pixels(image))
        return lens.undistort(depth) if depth.shape == (lens.camera.height, lens.camera.width) else depth

    times = ((clock.times_ns - clock.times_ns[0]) / SECOND_NS).tolist()
    scale = given.depth_scale or (1.0 if floats else units_of(bag, topic))
    fps = rate_of(times)
    source = Source(path.stem, lens.camera, range(len(times)), read, scale, fps, times, mirrored=False)
    return source.changed(colours=colours_in(bag, first, clock, lens, 0.5 / fps))


def depth_topic(bag: Bag) -> str:
    """The topic with depth images: of those with depth in their names the least compressed one."""
    images = [*bag.topics(IMAGE), *bag.topics(COMPRESSED)]
    lossy = None
    for topic in sorted(images, key=lambda name: ("depth" not in name.lower(), name.endswith(PICTURES))):
        message = bag.message(topic)
        if encoding_of(message) in ENCODINGS:
            if not is_jpeg(message):
                return topic
            lossy = lossy or topic
    record = "record the camera's depth topic"
    if lossy is not None:
        lost = f"{lossy} holds depth as JPEG, which destroys it"
        raise InputError(f"{bag.path}: {lost}; {record} without compression, or {TRANSPORT}")
    raise InputError(f"{bag.path} holds no depth images (16UC1 or 32FC1); {record}")


def camera_of(bag: Bag, topic: str, image: object) -> Lens:
    """The camera of a topic's images, by a camera_info of their namespace or frame, else InputError."""
    infos = {each: bag.message(each) for each in bag.topics(CAMERA)}
    if not infos:
        raise InputError(f"{bag.path} holds no camera_info; record it, or add --intrinsics fx,fy,cx,cy")
    own = [each for each in infos if is_camera_of(infos[each], each, image, topic)]
    if not own:
        other = nearest(topic, [*infos])
        camera = lens_in(infos[other], other, str(bag.path)).camera
        values = ",".join(f"{value:.6g}" for value in camera.pinhole)
        raise InputError(
            f"{bag.path}: {other} is of another camera than {topic}; record the depth camera's camera_info, "
            f"or add --intrinsics fx,fy,cx,cy ({values} are those of {other})"
        )
    chosen = nearest(topic, own)
    return lens_in(infos[chosen], topic, str(bag.path))


def units_of(bag: Bag, topic: str) -> float:
    """Units of depth per metre."""
    stated = [t for t in bag.topics(NUMBER) if t.endswith("/Depth_Units/value")]
    if not stated:
        return MILLIMETRES
    # a float32: 0.0010000000474974513 means 0.001
    metres = float(str(np.float32(bag.message(nearest(topic, stated)).data)))
    if not 0 < metres < np.inf:
        raise InputError(f"{bag.path}: the stated unit of depth is {metres} m; record it again")
    return round(1.0 / metres, 6)


def nearest(topic: str, others: list[str]) -> str:
    """The topic whose name has the most leading levels in common with `topic`."""

    def shared(other: str) -> int:
        return len([*takewhile(bool, map(eq, topic.split("/"), other.split("/")))])

    return max(others, key=shared)
