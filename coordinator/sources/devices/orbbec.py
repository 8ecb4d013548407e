"""Orbbec cameras and their recordings, by Orbbec's SDK."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyorbbecsdk as ob
from numpy.typing import ArrayLike

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import View
from gepf.coordinator.sources.devices.device import LIMITS, Camera, CameraLost, Shot
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.source import downward

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MODELS = ("NONE", "BROWN_CONRADY", "BROWN_CONRADY_K6")
FAILURES = (RuntimeError, ob.OBError)


def open_device(which: str, colour: bool) -> Camera | None:
    """Open a camera by its serial number, or any, or a recording; None if there is no such camera."""
    ob.Context.set_logger_to_file(ob.OBLogLevel.NONE, ".")  # else it makes a folder of logs here
    ob.Context.set_logger_level(ob.OBLogLevel.NONE)
    if Path(which).suffix:
        try:
            return configured(ob.PlaybackDevice(which), colour=colour, playback=True)
        except FAILURES as error:
            raise InputError(f"orbbec: cannot play {which} back: {error}; give another file") from error
    found = ob.Context().query_devices()
    for device in (found[n] for n in range(len(found))):
        if which in ("", device.get_device_info().get_serial_number()):
            return configured(device, colour=colour, playback=False)
    return None


def configured(device: Any, *, colour: bool, playback: bool) -> Camera:
    """The camera with its default mode of depth."""
    pipeline, config, facts = ob.Pipeline(device), ob.Config(), device.get_device_info()
    depths = pipeline.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR)
    depth = depths.get_default_video_stream_profile()
    config.enable_stream(depth)
    with suppress(*FAILURES):  # it may have none
        if colour:
            profiles = pipeline.get_stream_profile_list(ob.OBSensorType.COLOR_SENSOR)
            config.enable_stream(profiles.get_video_stream_profile(0, 0, ob.OBFormat.RGB, 0))
    with suppress(*FAILURES):  # it has none
        device.get_sensor(ob.OBSensorType.ACCEL_SENSOR)
        config.enable_accel_stream()
        config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.ANY_SITUATION)
    lens, bent = depth.get_intrinsic(), depth.get_distortion()
    if bent.model.name not in MODELS:
        raise InputError(f"orbbec: the lens model {bent.model.name} is unknown; choose another depth mode")
    camera = Intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
    size = f"{depth.get_width()}x{depth.get_height()} at {depth.get_fps()} frames/s"
    straight = Lens(camera, [getattr(bent, name) for name in COEFFICIENTS])
    images = shots(pipeline, config, depth, straight, playback=playback)
    return Camera(f"{facts.get_name()} {facts.get_serial_number()}, {size}", images)


def shots(pipeline: Any, config: Any, profile: Any, lens: Lens, *, playback: bool) -> Generator[Shot]:
    """Start, yield the images as they come, and stop."""
    accelerations = deque[ArrayLike](maxlen=LIMITS.averaged)
    align = ob.AlignFilter(ob.OBStreamType.DEPTH_STREAM)
    try:
        pipeline.start(config)
    except FAILURES as error:
        raise CameraLost(f"does not start ({error})") from error
    try:
        while (frames := pipeline.wait_for_frames(LIMITS.silence_ms)) is not None:
            depth, colour = frames.get_depth_frame(), None
            if (accelerated := frames.get_frame(ob.OBFrameType.ACCEL_FRAME)) is not None:
                sample = accelerated.as_accel_frame()
                turn = np.reshape(sample.get_stream_profile().get_extrinsic_to(profile).rot, (3, 3))
                accelerations.append(turn @ [sample.get_x(), sample.get_y(), sample.get_z()])
            if depth is None:
                continue
            size = depth.get_height(), depth.get_width()
            if frames.get_color_frame() is not None:
                registered = align.process(frames).as_frame_set().get_color_frame()
                colour = np.frombuffer(registered.get_data(), np.uint8).reshape(*size, 3)
            units = lens.undistort(np.frombuffer(depth.get_data(), np.uint16).reshape(size))
            time_s = depth.get_timestamp_us() * 1e-6
            scale = 1000.0 / depth.get_depth_scale()  # it gives millimetres
            number, gravity = depth.get_index(), downward(accelerations)
            yield View(number, time_s, units, scale, lens.camera, gravity=gravity), colour
        if not playback:
            raise CameraLost("no image comes; it may be unplugged")
    finally:
        pipeline.stop()
