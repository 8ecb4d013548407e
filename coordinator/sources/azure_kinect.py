"""An `.mkv` of the recorder of Azure Kinect or of an Orbbec camera, read by PyAV.

Depth is a stream of 16-bit grey images in millimetres. The factory calibration is attached as JSON. Its lens
is in units of a sensor of 1024 x 1024, of which each depth mode uses a part, with or without 2 x 2 binning
(Azure Kinect Sensor SDK, `mode_specific_calibration.c`). Lens distortion is corrected. The accelerometer
samples, rotated to the axes of the depth camera, give the direction of gravity. Colour is
registered to depth.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import av
import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources.camera import MILLIMETRES, GivenCamera
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.registration import ColourCamera
from gepf.coordinator.sources.source import Source, downward, rate_of

MODES = {
    # depth mode: size of the sensor after binning, then left and top of the used part
    "NFOV_UNBINNED": (1024, 192, 180),
    "NFOV_2X2BINNED": (512, 96, 90),
    "WFOV_UNBINNED": (1024, 0, 0),
    "WFOV_2X2BINNED": (512, 0, 0),
}
COLOUR, COLOURS = "COLOR", "rgb24"  # title of the stream, and the format in which it is decoded
IMU_SAMPLE = np.dtype([("acc_ns", "<u8"), ("acc", "<f4", 3), ("gyro_ns", "<u8"), ("gyro", "<f4", 3)])


@dataclass(frozen=True, slots=True)
class Calibration:
    """The lens of the depth camera in units of the sensor, and the axes of the accelerometer.

    Args:
        lens: cx, cy, fx, fy, radial k1 to k6, two unused values, tangential p2, p1.
        radius: Radius of the field of view, in units of the focal length.
        turn: Rotation (9,) by rows, from the axes of the depth camera to those of the accelerometer.
        colour: As `lens`, of the colour camera in units of the width and height of a 4:3 image.
        T_colour_depth: Rotation (9,) by rows and translation (3,), metres. Both are empty if unknown.
    """

    lens: list[float]
    radius: float
    turn: list[float] | None
    colour: list[float] = field(default_factory=list)
    T_colour_depth: list[float] = field(default_factory=list)


def read_azure_kinect(path: Path, given: GivenCamera) -> Source:
    """Read the depth frames of an `.mkv`, numbered from 0; times are relative to the first frame."""
    with open_container(path) as container:
        stream = depth_stream(container, path)
        colour = next((s for s in container.streams.video if s.metadata.get("title") == COLOUR), None)
        stamps, seen, samples = scan(container, stream, colour, path)
        calibration = read_calibration(container, path)
        if calibration is None or given.intrinsics is not None:
            lens = Lens(given.camera((stream.height, stream.width), path))
        else:
            lens = lens_of(calibration, depth_camera(calibration, stream, path))
        camera = None if colour is None else colour_camera(calibration, colour)
        pictures = Frames(path, stamps, stream.index)
        coloured = Frames(path, seen, colour.index, COLOURS) if colour is not None and seen else None
    times = [stamp - stamps[0] for stamp in stamps]

    def read(place: int) -> NDArray[np.uint16]:
        return lens.undistort(pictures.read(place).astype(np.uint16))

    scale, gravity = given.depth_scale or MILLIMETRES, gravity_of(calibration, samples)
    fps = rate_of(times)
    source = Source(
        path.stem, lens.camera, range(len(times)), read, scale, fps, times, gravity, mirrored=False
    )
    if camera is None or coloured is None:
        return source

    def colours(number: int) -> NDArray[np.uint8] | None:
        near = int(np.abs(np.array(seen) - stamps[number]).argmin())
        if abs(seen[near] - stamps[number]) > 0.5 / fps:
            return None
        depth_m = read(number) / np.float32(scale)
        try:
            return camera.register(coloured.read(near).astype(np.uint8), depth_m, lens.camera)
        except InputError:  # damaged
            return None

    return source.changed(colours=colours)


class Frames:
    """Decoded pictures of a stream of a file. Reading is fastest in order; the last one is kept.

    The file is open from the first frame that is read to the last one of the file, or as long as this exists.
    """

    def __init__(self, path: Path, stamps: list[float], index: int, form: str | None = None) -> None:
        self._path, self._stamps, self._index, self._form = path, stamps, index, form
        self._next, self._pictures = 0, decode(path, index, stamps[0], form)
        self._last: NDArray[np.generic] | None = None

    def read(self, place: int) -> NDArray[np.generic]:
        """The picture (H, W) or (H, W, 3) of the n-th frame, counted from 0."""
        if place == self._next - 1 and self._last is not None:
            return self._last
        if place != self._next:
            self._pictures.close()
            self._pictures = decode(self._path, self._index, self._stamps[place], self._form)
        self._last = next(self._pictures, None)
        self._next = place + 1
        if self._last is None:
            raise InputError(f"{self._path}: frame {place} is truncated; copy it again, or use --frames")
        if self._next == len(self._stamps):
            self._pictures.close()
        return self._last


def decode(path: Path, index: int, from_s: float, form: str | None) -> Generator[NDArray[np.generic]]:
    """Pictures of a stream from a time on, up to the end or a damaged part of the file."""
    with open_container(path) as container:
        stream = container.streams[index]
        base = float(stream.time_base)
        container.seek(round(from_s / base), stream=stream)
        try:
            for picture in container.decode(stream):
                if picture.time >= from_s - 0.5 * base:
                    yield picture.to_ndarray(format=form)
        except av.error.FFmpegError:
            return


def open_container(path: Path) -> Any:
    """Open the container; InputError if it is not one."""
    try:
        return av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        raise InputError(f"{path} is damaged or not a Matroska file ({error}); copy it again") from error


def depth_stream(container: Any, path: Path) -> Any:
    """The stream with depth; InputError if there is none."""
    for stream in container.streams.video:
        named = "DEPTH" in stream.metadata.get("title", "").upper() or "K4A_DEPTH_MODE" in stream.metadata
        if named and stream.codec_context.pix_fmt in ("gray16be", "gray16le"):
            return stream
    raise InputError(f"{path} holds no 16-bit depth stream; record with k4arecorder -d NFOV_UNBINNED")


def scan(container: Any, stream: Any, colour: Any, path: Path) -> tuple[list[float], list[float], Array]:
    """Times of the depth and the colour frames in seconds, and measured accelerations (N, 3)."""
    times: list[float] = []
    coloured: list[float] = []
    samples: list[Array] = []
    inertial = [s for s in container.streams if s.metadata.get("title") == "IMU"]
    try:
        for packet in container.demux(stream, *inertial, *([] if colour is None else [colour])):
            if packet.size and packet.stream == stream:
                times.append(float(packet.pts * packet.time_base))
            elif packet.stream == colour:
                if packet.size:
                    coloured.append(float(packet.pts * packet.time_base))
            elif packet.size >= IMU_SAMPLE.itemsize:
                whole = packet.size // IMU_SAMPLE.itemsize * IMU_SAMPLE.itemsize
                samples.append(np.frombuffer(bytes(packet)[:whole], IMU_SAMPLE)["acc"].astype(np.float64))
    except av.error.FFmpegError as error:
        raise InputError(f"{path} is damaged ({error}); copy it again") from error
    if not times:
        raise InputError(f"{path} holds no depth frame; record it again")
    return times, coloured, np.concatenate([np.empty((0, 3)), *samples])


def read_calibration(container: Any, path: Path) -> Calibration | None:
    """The attached calibration; None if there is none, InputError if it is damaged."""
    for stream in container.streams:
        if stream.type == "attachment" and "K4A_CALIBRATION_FILE" in stream.metadata:
            try:
                content = msgspec.json.decode(bytes(stream.data).rstrip(b"\0"))["CalibrationInformation"]
                depth, colour = (
                    find_entry(content["Cameras"], "Purpose", f"CALIBRATION_CameraPurpose{purpose}")
                    for purpose in ("Depth", "PhotoVideo")
                )
                placed = [*colour["Rt"]["Rotation"], *colour["Rt"]["Translation"]] if colour else []
                inertial = content.get("InertialSensors", [])
                kind = "CALIBRATION_InertialSensorType_Accelerometer"
                sensor = find_entry(inertial, "SensorType", kind)
                return Calibration(
                    lens=msgspec.convert(
                        depth["Intrinsics"]["ModelParameters"] if depth else [], list[float]
                    ),
                    radius=msgspec.convert(depth.get("MetricRadius", 0.0), float),
                    turn=msgspec.convert(sensor["Rt"]["Rotation"], list[float]) if sensor else None,
                    colour=msgspec.convert(
                        colour["Intrinsics"]["ModelParameters"] if colour else [], list[float]
                    ),
                    T_colour_depth=msgspec.convert(placed, list[float]),
                )
            except (msgspec.MsgspecError, LookupError, TypeError, AttributeError) as error:
                raise InputError(f"{path}: damaged calibration ({error}); give --intrinsics") from error
    return None


def find_entry(entries: list[dict[str, Any]], key: str, value: str) -> dict[str, Any]:
    """The first entry of a list with this value for a key; empty if there is none."""
    return next((entry for entry in entries if entry[key] == value), {})


def depth_camera(calibration: Calibration, stream: Any, path: Path) -> Intrinsics:
    """The pinhole camera of the depth mode of the stream, with pixel centres at integers."""
    mode = stream.metadata.get("K4A_DEPTH_MODE", "")
    if mode not in MODES or len(calibration.lens) < 14:
        raise InputError(f"{path}: unknown calibration or depth mode '{mode}'; give --intrinsics")
    cx, cy, fx, fy = calibration.lens[:4]
    binned, left, top = MODES[mode]
    centre = (cx * binned - left - 0.5, cy * binned - top - 0.5)
    return Intrinsics(stream.width, stream.height, fx * binned, fy * binned, *centre)


def colour_camera(calibration: Calibration | None, stream: Any) -> ColourCamera | None:
    """The colour camera of a stream, whose images are the middle of 4:3 ones; None if it is unknown."""
    if calibration is None or len(calibration.colour) < 14 or len(calibration.T_colour_depth) != 12:
        return None
    cx, cy, fx, fy = calibration.colour[:4]
    width, height = stream.width, 0.75 * stream.width
    centre = (cx * width - 0.5, cy * height - 0.5 * (height - stream.height) - 0.5)
    camera = Intrinsics(stream.width, stream.height, fx * width, fy * height, *centre)
    T_colour_depth = np.eye(4)
    T_colour_depth[:3, :3] = np.reshape(calibration.T_colour_depth[:9], (3, 3))
    T_colour_depth[:3, 3] = calibration.T_colour_depth[9:]
    return ColourCamera(Lens(camera, coefficients_of(calibration.colour)), T_colour_depth)


def lens_of(calibration: Calibration, camera: Intrinsics) -> Lens:
    """The lens of the depth camera."""
    return Lens(camera, coefficients_of(calibration.lens), calibration.radius)


def coefficients_of(lens: list[float]) -> tuple[float, ...]:
    """The coefficients of distortion of a calibration, in the order of `Lens`."""
    k1, k2, k3, k4, k5, k6, _, _, p2, p1 = lens[4:14]
    return k1, k2, p1, p2, k3, k4, k5, k6


def gravity_of(calibration: Calibration | None, samples: Array) -> Array | None:
    """Direction of gravity (3,) as a unit vector in the axes of the depth camera; None if not measured."""
    direction = downward(samples) if samples.any() else None
    if direction is None or calibration is None or calibration.turn is None or len(calibration.turn) != 9:
        return None
    return np.reshape(calibration.turn, (3, 3)).T @ direction
