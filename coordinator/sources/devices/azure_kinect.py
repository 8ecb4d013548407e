"""The Azure Kinect, by pyk4a and Microsoft's SDK."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from contextlib import suppress

import numpy as np
import pyk4a
from numpy.typing import ArrayLike

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import View
from gepf.coordinator.sources.devices.device import LIMITS, Camera, CameraLost, Shot
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.source import downward


def open_device(which: str, colour: bool) -> Camera | None:
    """Open a camera by its serial number, or any; None if there is no such camera."""
    if which.endswith(".mkv"):
        raise InputError(f"azure-kinect: cannot play recordings; use gepf publish {which} instead")
    resolution = pyk4a.ColorResolution.RES_720P if colour else pyk4a.ColorResolution.OFF
    config = pyk4a.Config(color_resolution=resolution, synchronized_images_only=False)
    for number in range(pyk4a.connected_device_count()):
        device = pyk4a.PyK4A(config, device_id=number)
        with suppress(pyk4a.K4AException):  # no permission, or it is in use
            device.open()
            if which in ("", device.serial):
                return Camera(f"Azure Kinect {device.serial}, NFOV_UNBINNED 640x576", shots(device))
            device.close()
    return None


def shots(device: pyk4a.PyK4A) -> Generator[Shot]:
    """Start, yield the images as they come, and stop. Their numbers follow from the times and the rate."""
    axes, calibration = pyk4a.CalibrationType, device.calibration
    accelerations = deque[ArrayLike](maxlen=LIMITS.averaged)
    (fx, _, cx), (_, fy, cy), _ = calibration.get_camera_matrix(axes.DEPTH).tolist()
    distortion = calibration.get_distortion_coefficients(axes.DEPTH).tolist()
    lens = Lens(Intrinsics(640, 576, fx, fy, cx, cy), distortion)
    turn, _ = calibration.get_extrinsic_parameters(axes.ACCEL, axes.DEPTH)
    try:
        device.start()
        while True:
            with suppress(pyk4a.K4ATimeoutException):
                while (sample := device.get_imu_sample(0)) is not None:
                    accelerations.append(turn @ sample["acc_sample"])
            capture = device.get_capture(LIMITS.silence_ms)
            if capture.depth is None:
                continue
            time_s, colour = capture.depth_timestamp_usec * 1e-6, capture.transformed_color
            units = lens.undistort(capture.depth)
            number, gravity = round(30.0 * time_s), downward(accelerations)
            rgb = None if colour is None else np.ascontiguousarray(colour[..., 2::-1])  # from BGRA
            yield View(number, time_s, units, 1000.0, lens.camera, gravity=gravity), rgb
    except pyk4a.K4AException as error:
        raise CameraLost(f"no image comes ({error}); it may be unplugged") from error
    finally:
        with suppress(pyk4a.K4AException):
            device.stop()
