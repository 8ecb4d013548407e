"""One interface for the depth cameras of all vendors, their problems, and their frames."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.errors import GepfError, InputError
from gepf.common.frame import View
from gepf.common.packages import MissingPackage, needs


class CameraLimits(msgspec.Struct, frozen=True):
    """What is expected of an attached camera."""

    silence_ms: int = 3000  #: without an image, after which it is lost
    retry_s: float = 1.0  #: between tries to open it again
    averaged: int = 200  #: accelerations for gravity: about a second


LIMITS = CameraLimits()
USB_DEVICES = Path("/sys/bus/usb/devices")
USB_NODES = Path("/dev/bus/usb")


class CameraLost(GepfError):
    """A camera has stopped: it was unplugged, or its driver failed."""


class CameraFailed(GepfError):
    """A camera has stopped and cannot come back: it never gave an image, or it is a recording."""


Shot = tuple[View, NDArray[np.uint8] | None]
"""A frame and its colours (H, W, 3), RGB, registered to depth; None if they were not requested.

Number and time are the camera's, so that a gap shows dropped images. The depth has no distortion.
"""


class Camera(NamedTuple):
    """A camera, or a recording that its vendor's SDK plays back in real time.

    mode: model, serial number, size and rate, for the user. shots: the images; it starts the camera at the
    first, stops it at its end, and raises CameraLost if none comes.
    """

    mode: str
    shots: Generator[Shot]


class Vendor(NamedTuple):
    """A vendor's package in Python, and its USB devices: the start of the product numbers of its cameras."""

    cameras: str
    package: str
    usb: str
    products: str


VENDORS = {
    "realsense": Vendor("RealSense", "pyrealsense2", "8086", "0"),
    "orbbec": Vendor("Orbbec", "pyorbbecsdk2", "2bc5", ""),
    "azure-kinect": Vendor("Azure Kinect", "pyk4a", "045e", "097"),
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
        with needs(name, f"{name}:"):
            module = import_module(f"gepf.coordinator.sources.devices.{name.replace('-', '_')}")
    except MissingPackage:
        raise
    except ImportError as error:
        raise InputError(f"{name}: {vendor.package} does not load ({error}); install its driver") from error
    opener: Callable[[str, bool], Camera | None] = module.open_device
    try:
        opened = opener(which, colour)
    except GepfError:
        raise
    except Exception as error:
        raise CameraFailed(f"{camera}: cannot be opened ({describe(error)}); plug it in again") from error
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
            return f"no permission for {node}; install its udev rules (docs/live.md), and plug it in again"
        return f"a {vendor.cameras} camera is connected, but not this one, or it is in use; plug it in again"
    return f"no {vendor.cameras} camera is connected to this host; plug one in"


class AttachedCamera:
    """Iterates over the images of a camera, as frames with colours, until it is closed.

    A lost camera is opened again as soon as it is back, whatever its SDK raised. Frames have the camera's
    numbers and times, which continue when it is opened again. `report` is called with messages for the user,
    and `dropped` is the number of missing frames. InputError if there is no such camera at first. The
    iteration raises CameraFailed if the SDK fails before the very first image, or during the playback of a
    recording.
    """

    def __init__(self, camera: Path | str, report: Callable[[str], None], *, colour: bool = False) -> None:
        self.dropped = 0
        self._name, self._colour, self._report = camera, colour, report
        self._camera: Camera | None = self._open()
        self._closed = threading.Event()

    def close(self) -> None:
        """End the iteration after the present frame; callable from any thread."""
        self._closed.set()

    def __iter__(self) -> Iterator[Shot]:
        began, last = time.monotonic(), None
        while self._camera is not None:
            try:
                with closing(self._camera.shots) as shots:
                    for view, colour in self._continued(shots, began, last):
                        last = view
                        yield view, colour
            except Exception as error:  # an SDK may raise anything, also when it stops the camera
                if self._closed.is_set():
                    return
                line = f"{self._name}: {describe(error)}"
                waits = isinstance(error, CameraLost) or last is not None
                if not waits or plays_back(self._name):
                    raise CameraFailed(line) from error
                self._report(f"{line}; waiting for the camera to come back")
            else:
                return
            self._camera = self._reopen()

    def _continued(self, shots: Iterator[Shot], began: float, last: View | None) -> Iterator[Shot]:
        """The images of one opening, with numbers after the `last` one, and times in seconds from `began`."""
        before = None
        for view, colour in shots:
            if self._closed.is_set():
                return
            if before is None:
                shift = (0 if last is None else last.number + 1) - view.number
                now = time.monotonic() - began
                shift_s = (now if last is None else max(now, last.time_s + LIMITS.retry_s)) - view.time_s
            elif view.number > before + 1:
                if self.dropped == 0:
                    self._report(f"{self._name}: the camera dropped an image; is it in a USB 3 port?")
                self.dropped += view.number - before - 1
            before = view.number
            yield replace(view, number=view.number + shift, time_s=view.time_s + shift_s), colour

    def _open(self) -> Camera:
        camera = open_camera(self._name, colour=self._colour)
        self._report(f"{self._name}: {camera.mode}")
        return camera

    def _reopen(self) -> Camera | None:
        """The camera when it is back; None if this is closed before."""
        while not self._closed.wait(LIMITS.retry_s):
            with suppress(Exception):  # it is not there, or not ready
                return self._open()
        return None


def plays_back(camera: Path | str) -> bool:
    """Whether a recording is played back in place of a camera."""
    return bool(Path(str(camera).partition(":")[2]).suffix)


def describe(error: Exception) -> str:
    """What happened; for an error raised by an SDK, with its class."""
    return str(error) if isinstance(error, GepfError) else f"{type(error).__name__}: {error}"
