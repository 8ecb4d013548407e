"""RealSense cameras and recordings, by librealsense."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2 as rs

from common.camera import Intrinsics
from common.errors import InputError
from coordinator.sources.devices.device import SILENCE_MS, CameraLost, Gravity, Image
from coordinator.sources.lens import Lens

QUEUED = 8  # images and accelerations that wait
POLL_MS = 100
OVER = rs.playback_status.stopped


def open_device(which: str, colour: bool) -> RealSense | None:
    """Open a camera by its serial number, or any, or a recording; None if there is no such camera."""
    config = rs.config()
    if recorded := Path(which).suffix:
        if not Path(which).is_file():
            raise InputError(f"no such file: {which}; give realsense:SERIAL or a recording ({recorded})")
        config.enable_device_from_file(which, repeat_playback=False)
    elif which:
        config.enable_device(which)
    pipeline = rs.pipeline(rs.context())
    streams = [rs.stream.depth, *([rs.stream.color] if colour else [])]
    for stream in streams:
        config.enable_stream(stream)
    try:
        device = config.resolve(pipeline).get_device()
    except RuntimeError as error:
        if recorded:
            raise InputError(f"realsense: cannot play {which} back: {error}; record it again") from error
        return None
    profiles = (p for sensor in device.query_sensors() for p in sensor.get_stream_profiles())
    if any(profile.stream_type() == rs.stream.accel for profile in profiles):
        config.enable_stream(rs.stream.accel)
    return RealSense(pipeline, config)


class RealSense:
    """Implements Camera. Depth is stereo of rectified images, or its distortion is removed."""

    def __init__(self, pipeline: Any, config: Any) -> None:
        self._pipeline, self._config, self._started = pipeline, config, False
        self._queue = rs.frame_queue(QUEUED, keep_frames=True)
        profile = config.resolve(pipeline)
        self._device = profile.get_device()
        self._playback = self._device.as_playback() if self._device.is_playback() else None
        self._depth = profile.get_stream(rs.stream.depth).as_video_stream_profile()
        self._inertial = any(each.stream_type() == rs.stream.accel for each in profile.get_streams())
        self._align = rs.align(rs.stream.depth)
        self._last: int | None = None
        self._gravity = Gravity()
        lens = self._depth.get_intrinsics()
        self.intrinsics = Intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
        if any(lens.coeffs) and lens.model != rs.distortion.brown_conrady:
            raise InputError(f"realsense: the lens model {lens.model} is unknown; choose a mode without it")
        k1, k2, p1, p2, k3 = lens.coeffs
        self._lens = Lens(self.intrinsics, (k1, k2, p1, p2, k3))
        units_m = np.float32(self._device.first_depth_sensor().get_depth_scale())
        self.depth_scale = 1.0 / float(str(units_m))

    @property
    def mode(self) -> str:
        """Model, serial number, size and rate, for the user."""
        name, number = (
            self._device.get_info(fact) for fact in (rs.camera_info.name, rs.camera_info.serial_number)
        )
        gravity = ", gravity measured" if self._inertial else ""
        depth = self._depth
        return f"{name} {number}, {depth.width()}x{depth.height()} at {depth.fps()} frames/s{gravity}"

    def start(self) -> None:
        """Start the streams; CameraLost if that fails."""
        try:
            if self._playback is not None:  # else it may end before all streams have started
                self._playback.pause()
            self._pipeline.start(self._config, self._queue)
            if self._playback is not None:
                self._playback.resume()
        except RuntimeError as error:
            raise CameraLost(f"does not start ({error})") from error
        self._started = True

    def read(self) -> Image | None:
        """Wait for the next image; None at the end of a recording, CameraLost without an image."""
        waited_ms = 0
        while waited_ms < SILENCE_MS:
            there, frame = self._queue.try_wait_for_frame(POLL_MS)
            if not there:
                waited_ms += POLL_MS
                if self._playback is not None and self._playback.current_status() == OVER:
                    return None
            elif frame.is_motion_frame():
                at = frame.as_motion_frame().get_motion_data()
                self._gravity.add((at.x, at.y, at.z))  # in the axes of the depth camera
            elif not self._inertial or self._gravity.direction is not None:
                image = self._image(frame)
                if image.number != self._last:  # sets of frames repeat what is not new
                    self._last = image.number
                    return image
        raise CameraLost("no image comes; it may be unplugged")

    def close(self) -> None:
        """Stop the streams."""
        if self._started:
            self._pipeline.stop()

    def _image(self, frame: Any) -> Image:
        depth, colour = frame, None
        if frame.is_frameset():
            frames = frame.as_frameset()
            if frames.get_color_frame():
                frames = self._align.process(frames)
                colour = np.array(frames.get_color_frame().get_data())
            depth = frames.get_depth_frame()
        units = self._lens.undistort(np.array(depth.get_data(), dtype=np.uint16))
        time_s = depth.get_timestamp() / 1000.0
        return Image(depth.get_frame_number(), time_s, units, self._gravity.direction, colour)
