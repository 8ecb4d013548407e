"""A recorded depth sequence of any format, of one camera or of a rig."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gepf.common.arrays import Array
from gepf.common.camera import NOT_MOVED, Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import Frame, View
from gepf.coordinator.files import START_FILE, TRUTH_FILE
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.sources.gaps import close_gaps, is_sparse

UNITS_PER_METRE = 5000.0  # for metres: steps of 0.2 mm
SATURATED = np.iinfo(np.uint16).max
"""The largest value of a pixel stands for no depth: cameras write it where nothing was measured."""
FARTHEST_M = np.iinfo(np.uint16).max / UNITS_PER_METRE


@dataclass(frozen=True, eq=False)
class Source:
    """A recorded depth sequence. Frames are read one at a time, on request.

    Args:
        name: Name of the sequence, without folder and suffix.
        intrinsics: The camera of every frame.
        numbers: The frames' numbers, ascending; some may be missing in between.
        read: Returns depth (H, W) of the n-th frame, counted from 0: uint16, or floats; 0, NaN or the largest
            uint16 for no depth. Raises InputError if the frame is damaged.
        depth_scale: Units of this depth per metre.
        fps: Frames per second.
        times: Times of the frames, seconds, ascending; None for number over `fps`.
        gravity: Direction of gravity (3,), unit vector, frame of the camera or rig; None if unknown.
        folder: Folder that may hold ground truth and a start pose.
        camera: Name of the camera in its rig; empty for a camera alone.
        T_rig_camera: (4, 4), metres.
        offset_s: Added to the camera's time it gives the rig's.
        colours: Returns the colour image (h, w, 3), RGB, of the frame with a number, registered to depth, at
            any scale; None if it is missing. None without colour.
        mirrored: Whether the recorder mirrored the images, so that they were mirrored back; None if unknown.
        of_points: Whether images are made of points, which leave gaps wherever they are.
    """

    name: str
    intrinsics: Intrinsics
    numbers: Sequence[int]
    read: Callable[[int], NDArray[np.generic]]
    depth_scale: float
    fps: float = DEFAULT_FPS
    times: Sequence[float] | None = None
    gravity: Array | None = None
    folder: Path | None = None
    camera: str = ""
    T_rig_camera: Array = field(default_factory=NOT_MOVED.copy)
    offset_s: float = 0.0
    mirrored: bool | None = None
    of_points: bool = False
    colours: Callable[[int], NDArray[np.uint8] | None] | None = None

    @property
    def views(self) -> tuple[Source, ...]:
        """The sequences of all cameras."""
        return (self,)

    @property
    def truth(self) -> Path | None:
        """The file of true joint positions in the folder of the sequence, if there is one."""
        return self._beside(TRUTH_FILE)

    @property
    def init(self) -> Path | None:
        """The file with the start pose in the folder of the sequence, if there is one."""
        return self._beside(START_FILE)

    @property
    def times_s(self) -> Array:
        """Times (F,) of the frames by the rig's clock, seconds."""
        times = np.array(self.numbers) / self.fps if self.times is None else np.array(self.times)
        return times + self.offset_s

    def frame(self, number: int) -> Frame:
        """Read one frame; 0 for pixels without depth. Raises InputError if it is damaged."""
        return Frame.of(self.view(number))

    def view(self, number: int) -> View:
        """Read the image of this camera alone. Raises InputError if it is damaged."""
        return self._image(self.numbers.index(number))

    def changed(self, **changes: Any) -> Source:
        """The same sequence with other values of some fields."""
        known = {each.name: getattr(self, each.name) for each in fields(self)}
        return Source(**(known | changes))

    def mirrored_back(self) -> Source:
        """The same sequence with left and right exchanged."""
        camera, read, colours = self.intrinsics, self.read, self.colours

        def mirrored(number: int) -> NDArray[np.uint8] | None:
            found = None if colours is None else colours(number)
            return None if found is None else np.ascontiguousarray(found[:, ::-1])

        return self.changed(
            read=lambda place: read(place)[:, ::-1],
            colours=None if colours is None else mirrored,
            intrinsics=msgspec.structs.replace(camera, cx=camera.width - 1 - camera.cx),
            gravity=None if self.gravity is None else self.gravity * [-1.0, 1.0, 1.0],
            mirrored=True,
        )

    def without_colours(self) -> Source:
        """The same sequence without colour."""
        return self.changed(colours=None)

    def nearest(self, time_s: float, within_s: float) -> int | None:
        """The place of the frame nearest to a time of the rig, or the later of two; None if it is far off."""
        apart, rounding_s = np.abs(self.times_s - time_s), 1e-4  # of times in files
        place = int(np.flatnonzero(apart <= apart.min() + rounding_s)[-1])
        return place if apart[place] <= within_s + rounding_s else None

    def view_near(self, time_s: float, within_s: float) -> View | None:
        """The image of this camera near a time of the rig; None in a gap of its recording.

        Before and after its recording, an image without depth.
        """
        place, camera = self.nearest(time_s, within_s), self.intrinsics
        if place is not None:
            return self._image(place)
        if self.times_s[0] < time_s < self.times_s[-1]:
            return None
        dark = np.zeros((camera.height, camera.width), np.uint16)
        return View(0, time_s, dark, self.depth_scale, camera, self.camera, self.T_rig_camera)

    def _image(self, place: int) -> View:
        """The image of this camera at a place in `numbers`."""
        depth, scale = self._units(place)
        if self.is_sparse:
            depth = close_gaps(depth)
        number = self.numbers[place]
        time_s = (number / self.fps if self.times is None else self.times[place]) + self.offset_s
        return View(
            number,
            time_s,
            depth,
            scale,
            self.intrinsics,
            self.camera,
            self.T_rig_camera,
            colours=None if self.colours is None else self.colours(number),
        )

    @cached_property
    def is_sparse(self) -> bool:
        """Whether depth consists of points with narrow gaps in between, which are closed in all frames."""
        return is_sparse((depth for depth, _ in self._examined(3)), of_points=self.of_points)

    def examined(self) -> list[NDArray[np.float32]]:
        """Depth (H, W) in metres of ten frames, evenly spaced, without those that are damaged."""
        return [depth.astype(np.float32) / np.float32(scale) for depth, scale in self._examined(10)]

    def _examined(self, count: int) -> Iterator[tuple[NDArray[np.uint16], float]]:
        """Depth (H, W) and units per metre of frames that are evenly spaced, if they can be read."""
        for place in np.unique(np.linspace(0, len(self) - 1, count).astype(int)).tolist():
            with suppress(InputError):
                yield self._units(place)

    def _units(self, place: int) -> tuple[NDArray[np.uint16], float]:
        """Depth (H, W) as it was recorded, 0 for none, and its units per metre."""
        camera, depth, number = self.intrinsics, self.read(place), self.numbers[place]
        if depth.shape != (camera.height, camera.width):
            raise InputError(
                f"{self.name}: frame {number} is {depth.shape[1]}x{depth.shape[0]}, but its camera "
                f"{camera.width}x{camera.height}; give frames of one size and their camera"
            )
        if depth.dtype.kind == "f":
            return to_units(depth.astype(np.float64) / self.depth_scale), UNITS_PER_METRE
        return measured(depth.astype(np.uint16, copy=False)), self.depth_scale

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Frame]:
        return map(self.frame, self.numbers)

    def _beside(self, name: str) -> Path | None:
        return self.folder / name if self.folder and (self.folder / name).is_file() else None


@dataclass(frozen=True, eq=False)
class RigSource(Source):
    """The recordings of all cameras of a rig: `views`, one or more.

    There is a frame for each image of the first one, which gives the time. The other fields are its own.
    """

    views: tuple[Source, ...] = ()

    @classmethod
    def of(cls, name: str, views: Sequence[Source]) -> Self:
        """The rig of these cameras."""
        first = {each.name: getattr(views[0], each.name) for each in fields(Source)}
        return cls(**(first | {"name": name, "views": tuple(views)}))

    def frame(self, number: int) -> Frame:
        """Read one frame; 0 for pixels without depth. Raises InputError if it is damaged.

        Each other camera adds its nearest image in time, if that is within half a frame period. Before its
        first image and after its last, a camera adds an image without depth.
        """
        first, *beside = self.views
        image = first.view(number)
        near = (camera.view_near(image.time_s, 0.5 / self.fps) for camera in beside)
        return Frame.of(image, *(view for view in near if view is not None))

    def changed(self, **changes: Any) -> RigSource:
        """The same rig with other values of some fields."""
        return RigSource(**({each.name: getattr(self, each.name) for each in fields(self)} | changes))

    def without_colours(self) -> RigSource:
        """The same sequences without colour."""
        return self.changed(colours=None, views=tuple(view.without_colours() for view in self.views))


def measured(depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Depth with 0 also where the largest value stands for none."""
    return np.where(depth == SATURATED, 0, depth).astype(np.uint16) if (depth == SATURATED).any() else depth


def to_units(metres: Array, per_metre: float = UNITS_PER_METRE) -> NDArray[np.uint16]:
    """Convert metres to units; 0 for no depth, or depth that is too large."""
    units = np.rint(metres * per_metre)
    return np.where((units > 0.0) & (units <= np.iinfo(np.uint16).max), units, 0.0).astype(np.uint16)


def downward(accelerations: Collection[ArrayLike]) -> Array | None:
    """Direction of gravity (3,), unit vector, by an accelerometer's measurements (3,); None without any.

    At rest, an accelerometer measures the upward force that holds it.
    """
    if not len(accelerations):
        return None
    upward: Array = np.median(np.array(accelerations, dtype=np.float64), axis=0)
    return -upward / np.linalg.norm(upward)


def rate_of(seconds: Sequence[float] | Array) -> float:
    """Frames per second of ascending times: the inverse of the median time between frames."""
    return float(1.0 / np.median(np.diff(seconds))) if len(seconds) > 1 else DEFAULT_FPS


def rising(times: NDArray[np.floating]) -> Array:
    """Times (F,) that rise strictly: frames with one time are spread evenly up to the next time.

    Where the clock was set back, the usual time between two frames is assumed.
    """
    steps = np.diff(times.astype(np.float64))
    forward = steps[steps > 0.0]
    usual = float(np.median(forward)) if len(forward) else 1.0 / DEFAULT_FPS
    set_back = np.concatenate([[0.0], np.cumsum(np.where(steps < 0.0, usual - steps, 0.0))])
    distinct, first = np.unique(times + set_back, return_index=True)
    per_frame = (distinct[-1] - distinct[0]) / first[-1] if first[-1] else usual
    end = distinct[-1] + per_frame * (len(times) - first[-1])
    return np.asarray(np.interp(np.arange(len(times)), [*first, len(times)], [*distinct, end]))


def select_frames(numbers: Sequence[int], wanted: str | None) -> Sequence[int]:
    """The part `A:B` (half open, either end may be missing) of a sequence's frame numbers."""
    if wanted is None:
        return numbers
    first, colon, end = wanted.partition(":")
    there = f"this sequence has frames {numbers[0]}:{numbers[-1] + 1}"
    if not colon or not all(part.strip().isdecimal() for part in (first, end) if part):
        raise InputError(f"--frames '{wanted}' is not of the form A:B; {there}")
    start, stop = int(first or numbers[0]), int(end or numbers[-1] + 1)
    chosen = [number for number in numbers if start <= number < stop]
    if start < numbers[0] or stop > numbers[-1] + 1 or not chosen:
        raise InputError(f"--frames {wanted} is out of range or in a gap; {there}")
    return chosen
