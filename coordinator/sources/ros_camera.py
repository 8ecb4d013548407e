"""The camera of ROS images, by their camera_info (sensor_msgs/CameraInfo; REP 104)."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from gepf.coordinator.sources.camera import intrinsics_of
from gepf.coordinator.sources.lens import Lens

logger = logging.getLogger(__name__)

CAMERA = "sensor_msgs/msg/CameraInfo"
MODELS = ("plumb_bob", "rational_polynomial")
RECTIFIED = "rect"  # in the names of topics whose images are undistorted


def is_camera_of(info: Any, info_topic: str, image: Any, topic: str) -> bool:
    """Whether a camera_info describes an image: it has the same frame, or its namespace contains the image.

    Intel's recorder has a namespace of its own, `info`, beside that of the images.
    """
    frame, other = image.header.frame_id.strip("/"), info.header.frame_id.strip("/")
    space = info_topic.rpartition("/")[0].removesuffix("/info")
    inside = topic.startswith(f"{space}/")
    return inside or (frame == other != "")


def lens_in(info: Any, topic: str, name: str) -> Lens:
    """The camera and distortion of a topic's images, of ROS 1 or ROS 2; InputError if it is not calibrated.

    Images on topics of rectified images have the projection matrix P, and no distortion.
    """
    matrix, projection, distortion = (
        np.asarray(getattr(info, key.upper(), None) if hasattr(info, key.upper()) else getattr(info, key))
        for key in ("k", "p", "d")
    )
    matrix, projection = matrix.reshape(3, 3), projection.reshape(3, 4)[:, :3]
    rectified = RECTIFIED in "/".join(topic.split("/")[-2:])
    if rectified and projection[0, 0] > 0.0:
        matrix = projection
    camera = intrinsics_of(matrix, info.width, info.height, f"{name}: camera_info (uncalibrated camera?)")
    if rectified or not distortion.any():
        return Lens(camera)
    if info.distortion_model not in MODELS:
        logger.warning(
            "%s: the distortion model %s is not supported; distortion is not removed",
            name,
            info.distortion_model or "(none)",
        )
        return Lens(camera)
    return Lens(camera, tuple(np.pad(distortion[:8], (0, max(0, 5 - len(distortion)))).tolist()))
