"""RealSense cameras and recordings, by librealsense."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2 as rs
from numpy.typing import ArrayLike, NDArray

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import View
from gepf.coordinator.sources.devices.device import LIMITS, Camera, CameraLost, Shot
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.source import downward


def open_device(which: str, colour: bool) -> Camera | None:
    """Open a camera by its serial number, or any, or a recording; None if there is no such camera."""
    config = rs.config()
    if recorded := Path(which).suffix:
        if not Path(which).is_file():
            raise InputError(f"no such file: {which}; give realsense:SERIAL or a recording ({recorded})")
        config.enable_device_from_file(which, repeat_playback=False)
    elif which:
        config.enable_device(which)
    pipeline = rs.pipeline(rs.context())
    config.enable_stream(rs.stream.depth)
    try:
        device = config.resolve(pipeline).get_device()
    except RuntimeError as error:
        if recorded:
            raise InputError(f"realsense: cannot play {which} back: {error}; record it again") from error
        return None
    profiles = (p for sensor in device.query_sensors() for p in sensor.get_stream_profiles())
    streams = {profile.stream_type() for profile in profiles}
    if rs.stream.accel in streams:
        config.enable_stream(rs.stream.accel)
    if colour and rs.stream.color in streams:
        config.enable_stream(rs.stream.color)
        if not config.can_resolve(pipeline):  # its bus is too slow for both
            config.disable_stream(rs.stream.color)
    profile = config.resolve(pipeline)
    depth = profile.get_stream(rs.stream.depth).as_video_stream_profile()
    name, number = map(device.get_info, (rs.camera_info.name, rs.camera_info.serial_number))
    mode = f"{name} {number}, {depth.width()}x{depth.height()} at {depth.fps()} frames/s"
    return Camera(mode, shots(pipeline, config, profile, lens_of(depth)))


def lens_of(depth: Any) -> Lens:
    """The lens of a stream of depth, which is stereo of rectified images or has distortion."""
    lens = depth.get_intrinsics()
    if any(lens.coeffs) and lens.model != rs.distortion.brown_conrady:
        raise InputError(f"realsense: the lens model {lens.model} is unknown; choose a mode without it")
    return Lens(Intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy), lens.coeffs)


def shots(pipeline: Any, config: Any, profile: Any, lens: Lens) -> Generator[Shot]:
    """Start, yield the images as they come, and stop."""
    device, last, waited_ms = profile.get_device(), -1, 0
    accelerations = deque[ArrayLike](maxlen=LIMITS.averaged)
    inertial = any(each.stream_type() == rs.stream.accel for each in profile.get_streams())
    scale = 1.0 / float(str(np.float32(device.first_depth_sensor().get_depth_scale())))
    playback = device.as_playback() if device.is_playback() else None
    queue, align = rs.frame_queue(8, keep_frames=True), rs.align(rs.stream.depth)
    try:
        if playback is not None:  # else it may end before all streams have started
            playback.pause()
        pipeline.start(config, queue)
        if playback is not None:
            playback.resume()
    except RuntimeError as error:
        raise CameraLost(f"does not start ({error})") from error
    try:
        while waited_ms < LIMITS.silence_ms:
            there, image = queue.try_wait_for_frame(100)
            if not there:
                waited_ms += 100
                if playback is not None and playback.current_status() == rs.playback_status.stopped:
                    return
                continue
            if image.is_motion_frame():
                at = image.as_motion_frame().get_motion_data()
                accelerations.append((at.x, at.y, at.z))  # in the axes of the depth camera
            elif not inertial or accelerations:
                depth, colour = parts(image, align)
                number, time_s = depth.get_frame_number(), depth.get_timestamp() / 1000.0
                if number != last:  # sets of frames repeat what is not new
                    last, waited_ms = number, 0
                    units = lens.undistort(np.array(depth.get_data(), dtype=np.uint16))
                    gravity = downward(accelerations)
                    yield View(number, time_s, units, scale, lens.camera, gravity=gravity), colour
        raise CameraLost("no image comes; it may be unplugged")
    finally:
        pipeline.stop()


def parts(image: Any, align: Any) -> tuple[Any, NDArray[np.uint8] | None]:
    """The depth image of a frame or a set of frames, and its registered colours, if there are any."""
    if not image.is_frameset():
        return image, None
    frames, colour = image.as_frameset(), None
    if frames.get_color_frame():
        frames = align.process(frames)
        colour = np.array(frames.get_color_frame().get_data())
    return frames.get_depth_frame(), colour
