"""Messages of ROS about images, of any release: `types` are the classes of its messages by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.camera import Intrinsics

IMAGE, CAMERA = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
Types = Mapping[str, Any]


def header_of(types: Types, frame_id: str = "camera", sec: int = 0, nanosec: int = 0) -> Any:
    """A header; that of ROS 1 has a number, too."""
    make, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"](sec, nanosec)
    return make(*(0,) * ("seq" in make.__annotations__), stamp, frame_id)


def image_of(types: Types, header: Any, depth: NDArray[np.generic], encoding: str = "16UC1") -> Any:
    """An image."""
    step, data = depth.shape[1] * depth.dtype.itemsize, np.frombuffer(depth.tobytes(), np.uint8)
    return types[IMAGE](header, *depth.shape, encoding, 0, step, data)


def camera_of(types: Types, header: Any, camera: Intrinsics, distortion: Sequence[float] = (0.0,) * 5) -> Any:
    """The camera of images, with the distortion of a lens."""
    matrix = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1])
    region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    unused = np.eye(3).ravel(), np.zeros(12), 0, 0, region
    return types[CAMERA](
        header, camera.height, camera.width, "plumb_bob", np.array(distortion), matrix, *unused
    )
