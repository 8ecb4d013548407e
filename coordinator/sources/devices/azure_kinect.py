"""The Azure Kinect, by pyk4a and Microsoft's SDK."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pyk4a

from common.camera import Intrinsics
from common.errors import InputError
from coordinator.sources.devices.device import SILENCE_MS, CameraLost, Gravity, Image
from coordinator.sources.lens import Lens

FPS = 30
SETTINGS = {"depth_mode": pyk4a.DepthMode.NFOV_UNBINNED, "camera_fps": pyk4a.FPS.FPS_30}


def open_device(which: str, colour: bool) -> AzureKinect | None:
    """Open a camera by its serial number, or any; None if there is no such camera."""
    if which.endswith(".mkv"):
        raise InputError(f"azure-kinect: has no playback; gepf publish {which} publishes a recording")
    resolution = pyk4a.ColorResolution.RES_720P if colour else pyk4a.ColorResolution.OFF
    config = pyk4a.Config(color_resolution=resolution, synchronized_images_only=colour, **SETTINGS)
    for number in range(pyk4a.connected_device_count()):
        device = pyk4a.PyK4A(config, device_id=number)
        with suppress(pyk4a.K4AException):  # no permission, or it is in use
            device.open()
            if which in ("", device.serial):
                return AzureKinect(device, colour=colour)
            device.close()
    return None


class AzureKinect:
    """Implements Camera. Images have no number: it follows from the time and the rate."""

    depth_scale = 1000.0

    def __init__(self, device: pyk4a.PyK4A, *, colour: bool) -> None:
        self._device, self._colour, self._gravity = device, colour, Gravity()
        depth, calibration = pyk4a.CalibrationType.DEPTH, device.calibration
        (fx, _, cx), (_, fy, cy), _ = calibration.get_camera_matrix(depth).tolist()
        self.intrinsics = Intrinsics(640, 576, fx, fy, cx, cy)
        self._lens = Lens(self.intrinsics, calibration.get_distortion_coefficients(depth).tolist())
        self._turn, _ = calibration.get_extrinsic_parameters(pyk4a.CalibrationType.ACCEL, depth)

    @property
    def mode(self) -> str:
        """Model, serial number, size and rate, for the user."""
        return f"Azure Kinect {self._device.serial}, NFOV_UNBINNED 640x576 at {FPS} frames/s"

    def start(self) -> None:
        """Start the streams; CameraLost if that fails."""
        try:
            self._device.start()
        except pyk4a.K4AException as error:
            raise CameraLost(f"does not start ({error})") from error

    def read(self) -> Image | None:
        """Wait for the next image; CameraLost without one."""
        try:
            with suppress(pyk4a.K4ATimeoutException):
                while (sample := self._device.get_imu_sample(0)) is not None:
                    self._gravity.add(self._turn @ sample["acc_sample"])
            while (capture := self._device.get_capture(SILENCE_MS)).depth is None:
                continue
        except pyk4a.K4AException as error:
            raise CameraLost("no image comes; it may be unplugged") from error
        time_s = capture.depth_timestamp_usec * 1e-6
        colour = None
        if self._colour and capture.transformed_color is not None:
            colour = np.ascontiguousarray(capture.transformed_color[..., 2::-1])  # from BGRA
        units = self._lens.undistort(capture.depth)
        return Image(round(time_s * FPS), time_s, units, self._gravity.direction, colour)

    def close(self) -> None:
        """Stop the streams."""
        with suppress(pyk4a.K4AException):
            if self._device.is_running:
                self._device.stop()
