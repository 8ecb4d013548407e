"""An `.mkv` of Azure Kinect's recorder, or of an Orbbec camera's in its place, read by PyAV.

Depth is a stream of 16-bit grey pictures in millimetres. The factory's calibration is attached as JSON: a
lens in units of a sensor of 1024 x 1024, of which each depth mode shows a part, halved or not (Azure Kinect
Sensor SDK, `mode_specific_calibration.c`). The lens' distortion is undone. The accelerometer's samples,
turned into the depth camera's axes, give the direction of gravity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import msgspec
import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.sources.camera import AS_RECORDED, MILLIMETRES, CameraOptions, Distortion, Undistortion
from coordinator.sources.source import Recording, rate_of

Array = NDArray[np.float64]

MODES = {
    # depth mode: the sensor's size after binning, then left and top of what is shown
    "NFOV_UNBINNED": (1024, 192, 180),
    "NFOV_2X2BINNED": (512, 96, 90),
    "WFOV_UNBINNED": (1024, 0, 0),
    "WFOV_2X2BINNED": (512, 0, 0),
}
IMU_SAMPLE = np.dtype([("acc_ns", "<u8"), ("acc", "<f4", 3), ("gyro_ns", "<u8"), ("gyro", "<f4", 3)])
IMU_SAMPLES = 1600  # a second of them: the camera stands still
STANDARD_GRAVITY = 9.81
STILL = 0.15  # share of gravity by which a camera at rest may be accelerated


@dataclass(frozen=True, slots=True)
class Calibration:
    """Of the depth camera: its lens over the sensor's size, and how an accelerometer lies in its axes."""

    lens: list[float]  # cx, cy, fx, fy, k1 to k6, two that are not used, p2, p1
    radius: float  # of the field of view, in units of the focal length
    turn: list[float] | None  # (9,) row by row, from the depth camera's axes to those of the accelerometer


class AzureKinectFile(Recording):
    """The depth frames of one `.mkv`, numbered from 0; times are the recording's, from the first frame."""

    def __init__(self, path: Path, options: CameraOptions = AS_RECORDED) -> None:
        self.name, self._path = path.stem, path
        self._container = opened(path)
        self._stream = depth_stream(self._container, path)
        self._times, samples = scan(self._container, self._stream, path)
        size = (self._stream.width, self._stream.height)
        calibration = read_calibration(self._container, path)
        if calibration is None or options.intrinsics is not None:
            self.intrinsics, self._undistort = options.camera(*size, str(path)), None
        else:
            self.intrinsics, distortion = depth_camera(calibration, mode_of(self._stream, size, path), size)
            self._undistort = Undistortion(self.intrinsics, distortion)
        self.gravity = gravity_of(calibration, samples)
        self._scale = options.depth_scale or MILLIMETRES
        self.numbers = range(len(self._times))
        self.fps = rate_of(self._times)
        self._next, self._frames = 0, self._decode(0)

    def frame(self, number: int) -> DepthFrame:
        """One frame, undistorted. Those in order are read fastest."""
        if number != self._next:
            self._frames = self._decode(number)
        depth = next(self._frames, None)
        self._next = number + 1
        if depth is None:
            raise InputError(f"{self._path}: frame {number} is cut short; copy it again, or use --frames")
        depth = depth if self._undistort is None else self._undistort(depth)
        return DepthFrame(number, self._times[number] - self._times[0], depth, self._scale, self.intrinsics)

    def _decode(self, number: int) -> Iterator[NDArray[np.uint16]]:
        """Depth of the frames from `number` on; they end where the file is damaged."""
        base = float(self._stream.time_base)
        self._container.seek(round(self._times[number] / base), stream=self._stream)
        try:
            for picture in self._container.decode(self._stream):
                if picture.time >= self._times[number] - 0.5 * base:
                    yield picture.to_ndarray().astype(np.uint16)
        except av.error.FFmpegError:
            return


def opened(path: Path) -> Any:
    """The container; InputError if it is none."""
    try:
        return av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        raise InputError(f"{path} is damaged or no Matroska file ({error}); copy it again") from error


def depth_stream(container: Any, path: Path) -> Any:
    """The stream with depth; InputError where there is none."""
    for stream in container.streams.video:
        named = "DEPTH" in stream.metadata.get("title", "").upper() or "K4A_DEPTH_MODE" in stream.metadata
        if named and stream.codec_context.pix_fmt in ("gray16be", "gray16le"):
            return stream
    raise InputError(
        f"{path} holds no depth stream of 16-bit grey pictures; record it: k4arecorder -d NFOV_UNBINNED"
    )


def scan(container: Any, stream: Any, path: Path) -> tuple[list[float], Array]:
    """Times of the depth frames, seconds, and accelerations (N, 3) of the first second of samples."""
    times: list[float] = []
    samples: list[Array] = []
    inertial = [s for s in container.streams if s.metadata.get("title") == "IMU"]
    try:
        for packet in container.demux(stream, *inertial):
            if packet.size and packet.stream == stream:
                times.append(float(packet.pts * packet.time_base))
            elif packet.size >= IMU_SAMPLE.itemsize and sum(map(len, samples)) < IMU_SAMPLES:
                whole = packet.size // IMU_SAMPLE.itemsize * IMU_SAMPLE.itemsize
                samples.append(np.frombuffer(bytes(packet)[:whole], IMU_SAMPLE)["acc"].astype(np.float64))
    except av.error.FFmpegError as error:
        raise InputError(f"{path} is damaged ({error}); copy it again") from error
    if not times:
        raise InputError(f"{path} holds no depth frame; record it again")
    return times, np.concatenate([np.empty((0, 3)), *samples])


def read_calibration(container: Any, path: Path) -> Calibration | None:
    """The attached calibration; None where there is none, InputError where it is damaged."""
    for stream in container.streams:
        if stream.type == "attachment" and "K4A_CALIBRATION_FILE" in stream.metadata:
            try:
                content = msgspec.json.decode(bytes(stream.data).rstrip(b"\0"))["CalibrationInformation"]
                depth = find_entry(content["Cameras"], "Purpose", "CALIBRATION_CameraPurposeDepth")
                inertial = content.get("InertialSensors", [])
                kind = "CALIBRATION_InertialSensorType_Accelerometer"
                sensor = find_entry(inertial, "SensorType", kind)
                return Calibration(
                    lens=msgspec.convert(
                        depth["Intrinsics"]["ModelParameters"] if depth else [], list[float]
                    ),
                    radius=msgspec.convert(depth.get("MetricRadius", 0.0), float),
                    turn=msgspec.convert(sensor["Rt"]["Rotation"], list[float]) if sensor else None,
                )
            except (msgspec.MsgspecError, LookupError, TypeError, AttributeError) as error:
                raise InputError(
                    f"{path}: its calibration is damaged ({error}); give --intrinsics"
                ) from error
    return None


def find_entry(entries: list[dict[str, Any]], key: str, value: str) -> dict[str, Any]:
    """The first entry of a list that has this value under a key; empty where there is none."""
    return next((entry for entry in entries if entry[key] == value), {})


def mode_of(stream: Any, size: tuple[int, int], path: Path) -> tuple[int, int, int]:
    """How the sensor is cropped; InputError for a mode that is not known."""
    mode = stream.metadata.get("K4A_DEPTH_MODE", "")
    if mode not in MODES:
        raise InputError(
            f"{path}: depth mode '{mode}' of {size[0]}x{size[1]} is not known; give --intrinsics fx,fy,cx,cy"
        )
    return MODES[mode]


def depth_camera(
    calibration: Calibration, mode: tuple[int, int, int], size: tuple[int, int]
) -> tuple[Intrinsics, Distortion]:
    """The pinhole camera of a depth mode, pixel centres at whole numbers, and its lens' distortion."""
    if len(calibration.lens) < 14:
        raise InputError("the attached calibration knows no depth camera; give --intrinsics fx,fy,cx,cy")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = calibration.lens[:14]
    binned, left, top = mode
    lens = (fx * binned, fy * binned, cx * binned - left - 0.5, cy * binned - top - 0.5)
    distortion = Distortion((k1, k2, k3, k4, k5, k6), (p1, p2), calibration.radius or np.inf)
    return Intrinsics(*size, *lens), distortion


def gravity_of(calibration: Calibration | None, samples: Array) -> Array | None:
    """Unit vector (3,) along which things fall, in the depth camera's axes; None if not measured."""
    if calibration is None or calibration.turn is None or len(calibration.turn) != 9 or not len(samples):
        return None
    upward = np.median(samples, axis=0)  # at rest an accelerometer feels the ground's push
    if abs(np.linalg.norm(upward) - STANDARD_GRAVITY) > STILL * STANDARD_GRAVITY:
        return None
    sensor_from_depth = np.array(calibration.turn).reshape(3, 3)
    downward: Array = -sensor_from_depth.T @ upward
    return downward / np.linalg.norm(downward)
