"""Recordings of a RealSense camera that does not exist, written by its SDK from a device in software."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyrealsense2 as rs
from numpy.typing import NDArray

from gepf.common.camera import Intrinsics


def record(
    file: Path,
    depth: Sequence[NDArray[np.uint16]],
    camera: Intrinsics,
    fps: int,
    numbers: Sequence[int] | None = None,
    acceleration: tuple[float, float, float] | None = None,
    coefficients: Sequence[float] = (0.0,) * 5,
    colour: Sequence[NDArray[np.uint8]] | None = None,
    unit_m: float = 0.001,
    pause_s: float = 0.03,
) -> Path:
    """Record images, and an acceleration (3,) before them; they are played back with these pauses."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Rendered")
    device.register_info(rs.camera_info.serial_number, "1234")
    device.create_matcher(rs.matchers.dlr_c)
    sensor, inertial = device.add_sensor("Depth"), device.add_sensor("Motion")
    sensor.add_read_only_option(rs.option.depth_units, unit_m)
    profile = sensor.add_video_stream(video(rs.stream.depth, rs.format.z16, 2, camera, fps, coefficients))
    coloured = sensor.add_video_stream(video(rs.stream.color, rs.format.rgb8, 3, camera, fps, coefficients))
    coloured.register_extrinsics_to(profile, extrinsics())
    motion = rs.motion_stream()
    motion.type, motion.index, motion.uid, motion.fps = rs.stream.accel, 0, 9, 200
    motion.fmt = rs.format.motion_xyz32f
    accelerations = inertial.add_motion_stream(motion)
    accelerations.register_extrinsics_to(profile, extrinsics())
    recorder, queue = rs.recorder(str(file), device), rs.frame_queue(2 * len(depth) + 1)
    for each in recorder.query_sensors():
        wanted = (
            rs.stream.depth,
            *([rs.stream.color] if colour else []),
            *([rs.stream.accel] if acceleration else []),
        )
        opened = [p for p in each.get_stream_profiles() if p.stream_type() in wanted]
        if opened:
            each.open(opened)
            each.start(queue)
    if acceleration is not None:
        sample = rs.software_motion_frame()
        data = rs.vector()
        data.x, data.y, data.z = acceleration
        sample.data, sample.timestamp, sample.frame_number = data, 4_999.0, 1
        sample.domain, sample.profile = (
            rs.timestamp_domain.hardware_clock,
            accelerations.as_motion_stream_profile(),
        )
        inertial.on_motion_frame(sample)
        time.sleep(pause_s)
    for n, image in enumerate(depth):
        number = n + 1 if numbers is None else numbers[n]
        if colour is not None:
            sensor.on_video_frame(
                frame(np.ascontiguousarray(colour[n]), coloured, number, 5_000.0 + 1000.0 * n / fps)
            )
        sensor.on_video_frame(frame(image, profile, number, 5_000.0 + 1000.0 * n / fps))
        time.sleep(pause_s)
    for each in recorder.query_sensors():
        if each.get_active_streams():
            each.stop()
            each.close()
    del recorder
    return file


def video(
    stream: rs.stream, form: rs.format, size: int, camera: Intrinsics, fps: int, coefficients: Sequence[float]
) -> rs.video_stream:
    """A stream of images."""
    made, lens = rs.video_stream(), rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy = camera.width, camera.height, camera.fx, camera.fy
    lens.ppx, lens.ppy, lens.model, lens.coeffs = (
        camera.cx,
        camera.cy,
        rs.distortion.brown_conrady,
        list(coefficients),
    )
    made.type, made.index, made.uid, made.fmt, made.bpp = stream, 0, size, form, size
    made.width, made.height, made.fps, made.intrinsics = camera.width, camera.height, fps, lens
    return made


def frame(
    image: NDArray[np.generic], profile: rs.stream_profile, number: int, time_ms: float
) -> rs.software_video_frame:
    """An image for a sensor."""
    made = rs.software_video_frame()
    made.pixels, made.bpp, made.stride = (
        image,
        image.nbytes // (image.shape[0] * image.shape[1]),
        image.nbytes // image.shape[0],
    )
    made.timestamp, made.frame_number, made.domain = time_ms, number, rs.timestamp_domain.hardware_clock
    made.profile = profile.as_video_stream_profile()
    return made


def extrinsics() -> rs.extrinsics:
    """Of streams with the same axes and origin."""
    made = rs.extrinsics()
    made.rotation, made.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
    return made
