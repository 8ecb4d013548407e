"""Orbbec cameras and their recordings, by Orbbec's SDK."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyorbbecsdk as ob

from common.camera import Intrinsics
from common.errors import InputError
from coordinator.sources.devices.device import SILENCE_MS, CameraLost, Gravity, Image
from coordinator.sources.lens import Lens

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MODELS = ("NONE", "BROWN_CONRADY", "BROWN_CONRADY_K6")


def open_device(which: str, colour: bool) -> Orbbec | None:
    """Open a camera by its serial number, or any, or a recording; None if there is no such camera."""
    ob.Context.set_logger_to_file(ob.OBLogLevel.NONE, ".")  # else it makes a folder of logs here
    ob.Context.set_logger_level(ob.OBLogLevel.NONE)
    if Path(which).suffix:
        try:
            return Orbbec(ob.PlaybackDevice(which), colour=colour, playback=True)
        except (RuntimeError, ob.OBError) as error:
            raise InputError(f"orbbec: cannot play {which} back: {error}; give another file") from error
    found = ob.Context().query_devices()
    for device in (found[n] for n in range(len(found))):
        if which in ("", device.get_device_info().get_serial_number()):
            return Orbbec(device, colour=colour)
    return None


class Orbbec:
    """Implements Camera."""

    def __init__(self, device: Any, *, colour: bool, playback: bool = False) -> None:
        self._device, self._pipeline, self._config = device, ob.Pipeline(device), ob.Config()
        self._playback, self._gravity, self._started = playback, Gravity(), False
        self._depth = self._pipeline.get_stream_profile_list(
            ob.OBSensorType.DEPTH_SENSOR
        ).get_default_video_stream_profile()
        self._config.enable_stream(self._depth)
        self._align = None
        if colour:
            profiles = self._pipeline.get_stream_profile_list(ob.OBSensorType.COLOR_SENSOR)
            self._config.enable_stream(profiles.get_video_stream_profile(0, 0, ob.OBFormat.RGB, 0))
            self._align = ob.AlignFilter(ob.OBStreamType.DEPTH_STREAM)
        with suppress(RuntimeError, ob.OBError):  # it has none
            device.get_sensor(ob.OBSensorType.ACCEL_SENSOR)
            self._config.enable_accel_stream()
            self._config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.ANY_SITUATION)
        lens, bent = self._depth.get_intrinsic(), self._depth.get_distortion()
        if bent.model.name not in MODELS:
            raise InputError(
                f"orbbec: the lens model {bent.model.name} is unknown; choose another depth mode"
            )
        self.intrinsics = Intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
        self._lens = Lens(self.intrinsics, [getattr(bent, name) for name in COEFFICIENTS])
        self.depth_scale = 1000.0  # until the first image

    @property
    def mode(self) -> str:
        """Model, serial number, size and rate, for the user."""
        facts, depth = self._device.get_device_info(), self._depth
        name = f"{facts.get_name()} {facts.get_serial_number()}"
        return f"{name}, {depth.get_width()}x{depth.get_height()} at {depth.get_fps()} frames/s"

    def start(self) -> None:
        """Start the streams; CameraLost if that fails."""
        try:
            self._pipeline.start(self._config)
        except (RuntimeError, ob.OBError) as error:
            raise CameraLost(f"does not start ({error})") from error
        self._started = True

    def read(self) -> Image | None:
        """Wait for the next image; None at the end of a recording, CameraLost without an image."""
        while (frames := self._pipeline.wait_for_frames(SILENCE_MS)) is not None:
            if (accelerated := frames.get_frame(ob.OBFrameType.ACCEL_FRAME)) is not None:
                frame = accelerated.as_accel_frame()
                turn = np.reshape(frame.get_stream_profile().get_extrinsic_to(self._depth).rot, (3, 3))
                self._gravity.add(turn @ [frame.get_x(), frame.get_y(), frame.get_z()])
            if frames.get_depth_frame() is not None:
                return self._image(frames)
        if self._playback:
            return None
        raise CameraLost("no image comes; it may be unplugged")

    def close(self) -> None:
        """Stop the streams."""
        if self._started:
            self._pipeline.stop()

    def _image(self, frames: Any) -> Image:
        depth, colour = frames.get_depth_frame(), None
        self.depth_scale = 1000.0 / depth.get_depth_scale()  # it gives millimetres
        size = depth.get_height(), depth.get_width()
        if self._align is not None and frames.get_color_frame() is not None:
            registered = self._align.process(frames).as_frame_set().get_color_frame()
            colour = np.frombuffer(registered.get_data(), np.uint8).reshape(*size, 3)
        units = np.frombuffer(depth.get_data(), np.uint16).reshape(size)
        time_s = depth.get_timestamp_us() * 1e-6
        return Image(depth.get_index(), time_s, self._lens.undistort(units), self._gravity.direction, colour)
