"""What every depth sequence can do, whatever its format."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.files import START_FILE, TRUTH_FILE
from coordinator.sources.camera import AS_RECORDED, DEFAULT_FPS, CameraOptions


class Source(Protocol):
    """A recorded depth sequence. Frames are read one at a time, on request."""

    @property
    def name(self) -> str:
        """The sequence's own name, without its folder or suffix."""
        ...

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera of every frame."""
        ...

    @property
    def fps(self) -> float:
        """Frames per second: frame n was taken at n / fps seconds, or at its recorded time."""
        ...

    @property
    def numbers(self) -> Sequence[int]:
        """The frames' numbers, ascending; some may be missing in between."""
        ...

    @property
    def gravity(self) -> NDArray[np.float64] | None:
        """Unit vector (3,) along which things fall, camera frame; None where the recording does not say."""
        ...

    @property
    def truth(self) -> Path | None:
        """A file of true joint positions that comes with the sequence."""
        ...

    @property
    def init(self) -> Path | None:
        """A file with the pose to start from that comes with the sequence."""
        ...

    def frame(self, number: int) -> DepthFrame:
        """One frame, checked; all zero where the camera saw nothing. Raises InputError if damaged."""
        ...

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[DepthFrame]: ...


class Recording:
    """What sequences in files and folders have in common; a format adds the rest."""

    name: str
    intrinsics: Intrinsics
    fps: float
    numbers: Sequence[int]
    gravity: NDArray[np.float64] | None = None
    truth: Path | None = None
    init: Path | None = None

    def frame(self, number: int) -> DepthFrame:
        """One frame."""
        raise NotImplementedError

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[DepthFrame]:
        return map(self.frame, self.numbers)


class FolderRecording(Recording):
    """A recording in a folder, in which truth and start may lie beside the frames."""

    def __init__(self, path: Path) -> None:
        self.name = path.resolve().name
        beside = (path / TRUTH_FILE, path / START_FILE)
        self.truth, self.init = (file if file.is_file() else None for file in beside)


def rate_of(seconds: Sequence[float]) -> float:
    """Frames per second of ascending times: the inverse of the median time between frames."""
    return float(1.0 / np.median(np.diff(seconds))) if len(seconds) > 1 else DEFAULT_FPS


def select_frames(numbers: Sequence[int], wanted: str | None) -> Sequence[int]:
    """The part `A:B` (half open, either end may be missing) of a sequence's frame numbers."""
    if wanted is None:
        return numbers
    first, colon, end = wanted.partition(":")
    there = f"frames {numbers[0]}:{numbers[-1] + 1}"
    if not colon or not all(part.strip().isdecimal() for part in (first, end) if part):
        raise InputError(f"--frames '{wanted}' is not of the form A:B; this sequence has {there}")
    start = int(first) if first else numbers[0]
    stop = int(end) if end else numbers[-1] + 1
    if not numbers[0] <= start < stop <= numbers[-1] + 1:
        raise InputError(f"--frames {wanted} is out of range; this sequence has {there}")
    if isinstance(numbers, range):
        return range(start, stop)
    chosen = tuple(number for number in numbers if start <= number < stop)
    if not chosen:
        raise InputError(f"--frames {wanted} is a gap of this sequence; choose other frames")
    return chosen


class OverriddenSource(Recording):
    """A source with another camera or scale than it has of its own."""

    def __init__(self, source: Source, options: CameraOptions) -> None:
        own = source.intrinsics
        self._source, self._options = source, options
        self.name, self.numbers, self.fps = source.name, source.numbers, source.fps
        self.truth, self.init, self.gravity = source.truth, source.init, source.gravity
        self.intrinsics = options.camera(own.width, own.height, source.name) if options.intrinsics else own

    def frame(self, number: int) -> DepthFrame:
        """One frame, with the user's camera and scale instead of its own."""
        frame = self._source.frame(number)
        scale = self._options.depth_scale or frame.depth_scale
        return DepthFrame(number, frame.time_s, frame.depth, scale, self.intrinsics)


def with_options(source: Source, options: CameraOptions) -> Source:
    """The source with the camera and scale that the user names."""
    return source if options == AS_RECORDED else OverriddenSource(source, options)
