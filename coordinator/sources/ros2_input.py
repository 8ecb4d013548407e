"""Live input from ROS 2: depth images with the camera of their camera_info, and joint states."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection
from itertools import count

import numpy as np

from gepf.common.arrays import Array
from gepf.common.checks import check_camera
from gepf.common.errors import InputError, ProtocolError
from gepf.common.frame import View
from gepf.coordinator.sources.camera import MILLIMETRES
from gepf.coordinator.sources.clock import SECOND_NS
from gepf.coordinator.sources.joint_states import STATES, JointStates
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.sources.ros2 import Node, nanoseconds
from gepf.coordinator.sources.ros2_colour import ColourTopic
from gepf.coordinator.sources.ros_camera import CAMERA, lens_in
from gepf.coordinator.sources.ros_images import COMPRESSED, IMAGE, PICTURES, TRANSPORT, pixels
from gepf.coordinator.sources.source import UNITS_PER_METRE, to_units


class DepthTopic:
    """Gives the images of a topic to live frames, numbered in the order of their reception.

    The camera is that of the camera_info beside the images, whose distortion is undone; images that come
    before it are left out. Images without a stamp have the time of their reception.
    """

    def __init__(self, node: Node, topic: str, frames: LiveFrames, *, colour: bool = False) -> None:
        self._node, self._topic, self._frames = node, topic, frames
        self._colour = ColourTopic(node, topic) if colour else None
        self._kind = COMPRESSED if topic.endswith((TRANSPORT, PICTURES)) else IMAGE
        raw = topic.removesuffix(TRANSPORT).removesuffix(PICTURES)
        self._raw, self._camera_topic = raw, raw.rpartition("/")[0] + "/camera_info"
        self._lens: tuple[bytes, Lens] | None = None  # the last camera_info in use, and its lens
        self._stamped = True
        self._camera: bytes | None = None  # the last camera_info
        self._waits = False  # whether the last image came before any camera_info
        self._numbers = count()
        frames.explain = self._explain
        node.subscribe(self._camera_topic, CAMERA, self._receive_camera)
        node.subscribe(topic, self._kind, self._receive)

    def _receive_camera(self, payload: bytes) -> None:
        self._camera = payload

    def _receive(self, payload: bytes) -> None:
        self._waits = self._camera is None
        if not self._waits:
            self._frames.receive(payload, decode=self._decode)

    def _decode(self, payload: bytes) -> View:
        """The frame of an image, or ProtocolError."""
        node, message = self._node, self._node.read(payload, self._kind)
        try:
            lens = self._choose_lens(self._camera or b"")
            camera, depth, scale = lens.camera, pixels(message), MILLIMETRES
        except Exception as error:  # any, for a damaged image
            raise ProtocolError(str(error)) from error
        if depth.dtype.kind == "f":
            depth, scale = to_units(depth.astype(np.float64)), UNITS_PER_METRE
        check_camera(camera, scale)
        if depth.shape != (camera.height, camera.width):
            size = f"{depth.shape[1]}x{depth.shape[0]}"
            raise ProtocolError(f"it is {size}, but its camera_info says {camera.width}x{camera.height}")
        if not (now := nanoseconds(message.header.stamp)):
            now = time.time_ns()
            if self._stamped:
                self._frames.say(f"images on {self._topic} have no stamps; they get the time of reception")
            self._stamped = False
        node.began_ns, node.frame_id = node.began_ns or now, message.header.frame_id or node.frame_id
        time_s = (now - node.began_ns) / SECOND_NS
        image, colours = lens.undistort(depth.astype(np.uint16)), None
        if self._colour is not None:
            colours = self._colour.near(message, lens)
            if doubt := self._colour.take_doubt():
                self._frames.say(doubt)
        return View(next(self._numbers), time_s, image, scale, camera, colours=colours)

    def _choose_lens(self, payload: bytes) -> Lens:
        """The lens of a camera_info; its table of pixels is made once."""
        if self._lens is None or self._lens[0] != payload:
            lens = lens_in(self._node.read(payload, CAMERA), self._raw, self._camera_topic)
            if self._lens is not None and lens == self._lens[1]:  # another stamp
                lens = self._lens[1]
            self._lens = payload, lens
        return self._lens[1]

    def _explain(self) -> str:
        """Why no frame comes, as far as it is known."""
        if self._waits:
            return f", because no camera_info comes on {self._camera_topic}"
        if self._topic in self._node.topics(self._kind):
            return ""
        there = ", ".join(self._node.topics(IMAGE, COMPRESSED))
        return ", which nobody publishes" + (f"; images are on {there}" if there else "")


class JointTopic:
    """The latest joint states of a topic, radians and metres, named as in the first that fits the body."""

    def __init__(self, topic: str) -> None:
        self.hash = topic  # in place of that of recorded states
        self.names: tuple[str, ...] = ()
        self._states: deque[tuple[int, Array]] = deque(maxlen=1000)  # times in ns; 1 s of a fast controller

    def listen(self, node: Node, known: Collection[str], report: Callable[[str], None]) -> None:
        """Receive states; `report` is called once with a message if no joint is one of the known ones."""
        self._node, self._known, self._report, self._reported = node, known, report, False
        node.subscribe(self.hash, STATES, self._receive)

    def _receive(self, payload: bytes) -> None:
        try:
            message = self._node.read(payload, STATES)
            values = np.asarray(message.position, dtype=np.float64)
            if not self.names:
                names = tuple(message.name)
                JointStates(names, values, values[:, None]).check_names(self._known)
                self.names = names
        except (InputError, ProtocolError) as error:
            if not self._reported:
                self._report(str(error))
            self._reported = True
            return
        if tuple(message.name) == self.names and len(values) == len(self.names) and np.isfinite(values).all():
            self._states.append((nanoseconds(message.header.stamp), values))

    def at(self, time_s: float) -> Array:
        """Interpolated values (K,) at a time; NaN before the first and after the last."""
        states = sorted(self._states, key=lambda state: state[0])
        if not states:
            return np.full(len(self.names), np.nan)
        times = (np.array([time for time, _ in states]) - self._node.began_ns) / SECOND_NS
        return JointStates(self.names, times, np.array([values for _, values in states])).at(time_s)
