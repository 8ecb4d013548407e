"""One interface for the depth cameras of all vendors, their problems, and their frames."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.camera import Intrinsics
from common.errors import GepfError, InputError
from common.frame import DepthFrame

SILENCE_MS = 3000  # without an image, after which a camera is lost
RETRY_S = 1.0
AVERAGED = 200  # accelerations for gravity: about a second
USB_DEVICES = Path("/sys/bus/usb/devices")
USB_NODES = Path("/dev/bus/usb")


class CameraLost(GepfError):
    """A camera has stopped: it was unplugged, or its driver failed."""


class Image(NamedTuple):
    """One image of a camera.

    number: by the camera's count, so that a gap shows dropped images. time_s: of the camera's clock. depth:
    uint16 (H, W), without distortion. gravity: direction (3,), unit vector in the depth camera's frame; None
    if it is not measured. colour: uint8 (H, W, 3), RGB, registered to depth; None if it was not requested.
    """

    number: int
    time_s: float
    depth: NDArray[np.uint16]
    gravity: NDArray[np.float64] | None = None
    colour: NDArray[np.uint8] | None = None


class Gravity:
    """The direction of gravity by an accelerometer, whose axes are those of the depth camera."""

    def __init__(self) -> None:
        self._accelerations = deque[ArrayLike](maxlen=AVERAGED)

    def add(self, acceleration: ArrayLike) -> None:
        """Note a measured acceleration (3,): at rest, that of the upward force."""
        self._accelerations.append(acceleration)

    @property
    def direction(self) -> NDArray[np.float64] | None:
        """Unit vector (3,); None if nothing was measured."""
        if not self._accelerations:
            return None
        downward: NDArray[np.float64] = -np.median(np.array(self._accelerations, np.float64), axis=0)
        return downward / np.linalg.norm(downward)


class Camera(Protocol):
    """A camera, or a recording that its vendor's SDK plays back in real time."""

    @property
    def mode(self) -> str:
        """Model, serial number, size and rate, for the user."""
        ...

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the depth images, without distortion."""
        ...

    @property
    def depth_scale(self) -> float:
        """Units of depth per metre; valid after the first image."""
        ...

    def start(self) -> None:
        """Start the streams; CameraLost if that fails."""
        ...

    def read(self) -> Image | None:
        """Wait for the next image; None at the end of a recording, CameraLost without an image."""
        ...

    def close(self) -> None:
        """Stop the streams."""
        ...


@dataclass(frozen=True, slots=True)
class Vendor:
    """A vendor's package in Python, its USB devices, and where to get the rules of udev for them.

    products: the start of the product numbers of its depth cameras.
    """

    cameras: str
    package: str
    usb: str
    products: str
    rules: str


VENDORS = {
    "realsense": Vendor(
        "RealSense",
        "pyrealsense2",
        "8086",
        "0",
        "https://github.com/IntelRealSense/librealsense/tree/master/config",
    ),
    "orbbec": Vendor(
        "Orbbec", "pyorbbecsdk2", "2bc5", "", "https://github.com/orbbec/pyorbbecsdk/tree/main/scripts"
    ),
    "azure-kinect": Vendor(
        "Azure Kinect",
        "pyk4a",
        "045e",
        "097",
        "https://github.com/microsoft/Azure-Kinect-Sensor-SDK/tree/develop/scripts",
    ),
}


def vendor_of(sequence: Path | str) -> str | None:
    """The name before the colon of `realsense:[SERIAL|FILE]` and the like; None for other input."""
    name, colon, _ = str(sequence).partition(":")
    return name if colon and name in VENDORS else None


def open_camera(camera: Path | str, *, colour: bool = False) -> Camera:
    """Open `VENDOR:[SERIAL|FILE]`; InputError says why it is impossible, and how to fix it."""
    name, _, which = str(camera).partition(":")
    vendor = VENDORS[name]
    try:
        module = import_module(f"coordinator.sources.devices.{name.replace('-', '_')}")
    except ModuleNotFoundError:
        raise InputError(f"{name}: needs a package of its vendor; pip install 'gepf[{name}]'") from None
    except ImportError as error:
        raise InputError(f"{name}: {vendor.package} does not load ({error}); install its driver") from error
    opener: Callable[[str, bool], Camera | None] = module.open_device
    opened = opener(which, colour)
    if opened is None:
        raise InputError(f"{camera}: {explain_absence(vendor)}")
    return opened


def explain_absence(vendor: Vendor, devices: Path = USB_DEVICES, nodes: Path = USB_NODES) -> str:
    """Why the vendor's package shows no such camera, by the USB devices of this host, and what to do."""
    for described in devices.glob("*/idVendor"):
        facts = {
            name: (described.parent / name).read_text(encoding="ascii").strip()
            for name in ("idVendor", "idProduct", "busnum", "devnum")
        }
        if facts["idVendor"] != vendor.usb or not facts["idProduct"].startswith(vendor.products):
            continue
        node = nodes / f"{int(facts['busnum']):03}" / f"{int(facts['devnum']):03}"
        if not os.access(node, os.R_OK | os.W_OK):
            return (
                f"no permission for {node}; install the udev rules of {vendor.rules}, "
                "and plug the camera in again"
            )
        return f"a {vendor.cameras} camera is connected, but not this one, or it is in use; plug it in again"
    return f"no {vendor.cameras} camera is connected to this host; plug one in"


class AttachedCamera:
    """Iterates over the images of a camera, as frames with colour (H, W, 3) or None, until it is closed.

    A camera that is lost is opened again as soon as it is back. Frames have the camera's numbers and times
    since it was opened, continued over each opening. `report` is called with messages for the user, and
    `dropped` is the number of missing frames. InputError if there is no such camera at first.
    """

    def __init__(self, camera: Path | str, report: Callable[[str], None], *, colour: bool = False) -> None:
        self.dropped = 0
        self._name, self._colour, self._report = camera, colour, report
        self._camera: Camera | None = self._open()
        self._closed = threading.Event()

    def close(self) -> None:
        """End the iteration after the present frame; callable from any thread."""
        self._closed.set()

    def __iter__(self) -> Iterator[tuple[DepthFrame, NDArray[np.uint8] | None]]:
        began, last = time.monotonic(), None
        while self._camera is not None:
            with closing(self._camera) as camera:
                try:
                    camera.start()
                    for image in self._images(camera, began, last):
                        number, time_s, depth, gravity, colour = last = image
                        frame = DepthFrame(number, time_s, depth, camera.depth_scale, camera.intrinsics)
                        yield replace(frame, gravity=gravity), colour
                except CameraLost as error:
                    self._report(f"{self._name}: {error}; waiting for it")
                else:
                    return
            self._camera = self._reopen()

    def _images(self, camera: Camera, began: float, last: Image | None) -> Iterator[Image]:
        """The images of one opening, with numbers after the `last` one, and times in seconds from `began`."""
        before = None
        while not self._closed.is_set() and (image := camera.read()) is not None:
            if before is None:
                shift = (0 if last is None else last.number + 1) - image.number
                now = time.monotonic() - began
                shift_s = (now if last is None else max(now, last.time_s + RETRY_S)) - image.time_s
            elif image.number > before + 1:
                if self.dropped == 0:
                    self._report(f"{self._name}: the camera dropped an image; is it in a USB 3 port?")
                self.dropped += image.number - before - 1
            before = image.number
            yield image._replace(number=image.number + shift, time_s=image.time_s + shift_s)

    def _open(self) -> Camera:
        camera = open_camera(self._name, colour=self._colour)
        self._report(f"{self._name}: {camera.mode}")
        return camera

    def _reopen(self) -> Camera | None:
        """The camera when it is back; None if this is closed before."""
        while not self._closed.wait(RETRY_S):
            try:
                return self._open()
            except InputError:
                continue
        return None
