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
from coordinator.sources.camera import MILLIMETRES, CameraOptions
from coordinator.sources.source import Source, rate_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MODES = {
    # depth mode: the sensor's size after binning, then left and top of what is shown
    "NFOV_UNBINNED": (1024, 192, 180),
    "NFOV_2X2BINNED": (512, 96, 90),
    "WFOV_UNBINNED": (1024, 0, 0),
    "WFOV_2X2BINNED": (512, 0, 0),
}
IMU_SAMPLE = np.dtype([("acc_ns", "<u8"), ("acc", "<f4", 3), ("gyro_ns", "<u8"), ("gyro", "<f4", 3)])


@dataclass(frozen=True, slots=True)
class Calibration:
    """The depth camera's lens over the sensor's size, and the accelerometer's axes.

    Args:
        lens: cx, cy, fx, fy, radial k1 to k6, two that are not used, tangential p2, p1.
        radius: Of the field of view, in units of the focal length.
        turn: (9,) row by row, from the depth camera's axes to those of the accelerometer.
    """

    lens: list[float]
    radius: float
    turn: list[float] | None


def read_azure_kinect(path: Path, options: CameraOptions) -> Source:
    """The depth frames of one `.mkv`, numbered from 0; times are the recording's, from the first frame."""
    container = opened(path)
    stream = depth_stream(container, path)
    stamps, samples = scan(container, stream, path)
    calibration = read_calibration(container, path)
    shape = (stream.height, stream.width)
    pixels = None
    if calibration is None or options.intrinsics is not None:
        camera = options.camera(shape, path)
    else:
        camera = depth_camera(calibration, stream, path)
        pixels = lens_pixels(calibration, camera)
    read = Frames(path, container, stream, stamps, pixels).read
    times = [stamp - stamps[0] for stamp in stamps]
    scale, gravity = options.depth_scale or MILLIMETRES, gravity_of(calibration, samples)
    return Source(path.stem, camera, range(len(times)), read, scale, rate_of(times), times, gravity)


class Frames:
    """Decoded and undistorted depth of a stream. Frames in order are read fastest."""

    def __init__(
        self, path: Path, container: Any, stream: Any, stamps: list[float], pixels: Indices | None
    ) -> None:
        self._path, self._container, self._stream, self._stamps = path, container, stream, stamps
        self._pixels = pixels
        self._next, self._pictures = 0, self._decode(0)

    def read(self, place: int) -> NDArray[np.uint16]:
        """Depth (H, W) of the n-th frame, counted from 0."""
        if place != self._next:
            self._pictures = self._decode(place)
        depth = next(self._pictures, None)
        self._next = place + 1
        if depth is None:
            raise InputError(f"{self._path}: frame {place} is cut short; copy it again, or use --frames")
        return depth if self._pixels is None else undistorted(depth, self._pixels)

    def _decode(self, place: int) -> Iterator[NDArray[np.uint16]]:
        """Depth of the frames from the n-th on; they end where the file is damaged."""
        base = float(self._stream.time_base)
        self._container.seek(round(self._stamps[place] / base), stream=self._stream)
        try:
            for picture in self._container.decode(self._stream):
                if picture.time >= self._stamps[place] - 0.5 * base:
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
    """Times of the depth frames, seconds, and measured accelerations (N, 3)."""
    times: list[float] = []
    samples: list[Array] = []
    inertial = [s for s in container.streams if s.metadata.get("title") == "IMU"]
    try:
        for packet in container.demux(stream, *inertial):
            if packet.size and packet.stream == stream:
                times.append(float(packet.pts * packet.time_base))
            elif packet.size >= IMU_SAMPLE.itemsize:
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


def depth_camera(calibration: Calibration, stream: Any, path: Path) -> Intrinsics:
    """The pinhole camera of the stream's depth mode, pixel centres at whole numbers."""
    mode = stream.metadata.get("K4A_DEPTH_MODE", "")
    if mode not in MODES or len(calibration.lens) < 14:
        raise InputError(
            f"{path}: its calibration, or its depth mode '{mode}', is not known; "
            "give --intrinsics fx,fy,cx,cy"
        )
    cx, cy, fx, fy = calibration.lens[:4]
    binned, left, top = MODES[mode]
    centre = (cx * binned - left - 0.5, cy * binned - top - 0.5)
    return Intrinsics(stream.width, stream.height, fx * binned, fy * binned, *centre)


def lens_pixels(calibration: Calibration, camera: Intrinsics) -> Indices:
    """The flat index (H, W) of the lens' pixel that shows what each pixel of the camera sees; -1 for none."""
    k1, k2, k3, k4, k5, k6, _, _, p2, p1 = calibration.lens[4:14]
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    columns, rows = np.rint(across * camera.fx + camera.cx), np.rint(down * camera.fy + camera.cy)
    seen = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    if calibration.radius:
        seen &= r2 <= calibration.radius**2
    return np.where(seen, rows * camera.width + columns, -1.0).astype(np.int64)


def undistorted(depth: NDArray[np.uint16], pixels: Indices) -> NDArray[np.uint16]:
    """A depth image (H, W) whose pixels are taken from elsewhere; 0 where the lens saw nothing."""
    return np.where(pixels >= 0, depth.ravel()[pixels], 0).astype(np.uint16)


def gravity_of(calibration: Calibration | None, samples: Array) -> Array | None:
    """Unit vector (3,) along which things fall, in the depth camera's axes; None if not measured."""
    if calibration is None or calibration.turn is None or len(calibration.turn) != 9 or not samples.any():
        return None
    upward = np.median(samples, axis=0)  # an accelerometer at rest measures the ground's push
    downward: Array = -np.reshape(calibration.turn, (3, 3)).T @ upward
    return downward / np.linalg.norm(downward)
