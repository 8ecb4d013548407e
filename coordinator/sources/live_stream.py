"""The frames that one live camera sends: which of them follow each other, their rate and their clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import msgspec

from gepf.common.arrays import Array
from gepf.common.camera import NOT_MOVED
from gepf.common.frame import View
from gepf.common.protocol.keys import check_stream
from gepf.coordinator.sources.devices.device import vendor_of
from gepf.coordinator.sources.gaps import close_gaps, is_sparse
from gepf.coordinator.sources.source import measured

SCHEME, ROS_SCHEME = "zenoh:", "ros2:"
ORDER = "order"  # cause of a misfit


class StreamLimits(msgspec.Struct, frozen=True):
    """What is expected of the frames of a live camera."""

    new_stream_frames: int = 5  #: rejected ones that fit each other, which begin a new stream
    recent_frames: int = 30  #: from which rate and clock are measured
    silent_intervals: float = 3.0  #: usual intervals without a frame, after which a camera is silent
    clock_s: float = 0.5  #: more than the delays of two cameras can differ
    colours_kept: int = 4  #: colour images until their frames are taken


LIMITS = StreamLimits()


def live_key(sequence: Path | str) -> str | None:
    """The key of `zenoh:KEY` or of a camera, or the topic of `ros2:/TOPIC`, which starts with a slash.

    None for recordings; InputError if the key is invalid.
    """
    text = str(sequence)
    if vendor := vendor_of(text):
        return f"gepf/live/{vendor}"
    if text.startswith(ROS_SCHEME):
        return "/" + check_stream(text.removeprefix(ROS_SCHEME).removeprefix("/"))
    return check_stream(text.removeprefix(SCHEME)) if text.startswith(SCHEME) else None


def is_topic(key: str | None) -> bool:
    """Whether a key is a topic of ROS."""
    return key is not None and key.startswith("/")


def colour_key(key: str) -> str:
    """The key of the colour images of the frames that are published on `key`."""
    return f"{key}/color"


@dataclass(frozen=True, slots=True, eq=False)
class LiveCamera:
    """A camera that publishes on a key or a topic, alone or in a rig; other fields are those of `Source`."""

    key: str
    camera: str = ""
    T_rig_camera: Array = field(default_factory=NOT_MOVED.copy)
    offset_s: float = 0.0


class LiveStream:
    """The stream of one camera: all frames have one size, camera and depth scale, in ascending order.

    `waiting` is the newest image, which has not been taken yet, in the rig's frame and time. `received` is
    when the last frame that fits was received. Times of reception are seconds of the monotonic clock.
    """

    def __init__(self, camera: LiveCamera) -> None:
        self.camera = camera
        self.ended = False
        self.waiting: View | None = None
        self.received = -math.inf
        self.offset_s = camera.offset_s
        self.by_reception = False  # whether the offset is measured, because the given one is not plausible
        self.reported = set[str]()  # causes of rejected frames
        self._skip = 0  # from the camera's numbers to those of its frames
        self._last: View | None = None  # that fits, as received
        self._sparse: bool | None = None  # whether gaps of depth are closed; None before the first depth
        self._recent = deque[tuple[float, float]](maxlen=LIMITS.recent_frames)  # the camera's time, reception
        self._rejected = deque[View](maxlen=2 * LIMITS.new_stream_frames)  # since then

    @property
    def last_period_s(self) -> float:
        """Time in seconds between the last two frames; infinite if there are not two."""
        times = [time_s for time_s, _ in self._recent]
        return times[-1] - times[-2] if len(times) > 1 else math.inf

    @property
    def period_s(self) -> float:
        """Usual time in seconds between frames; infinite if it is unknown."""
        return usual_step([time_s for time_s, _ in self._recent])

    def lives(self, now: float) -> bool:
        """Whether a frame has come recently."""
        longest = LIMITS.silent_intervals * usual_step([received for _, received in self._recent])
        return bool(self._recent) and not self.ended and now - self.received <= longest

    def misfit(self, view: View) -> tuple[str, str] | None:
        """Why a frame does not follow the last one: the cause and a message; None if it does."""
        return None if self._last is None else find_misfit(view, self._last)

    def reject(self, view: View) -> bool:
        """Note a frame that does not fit; returns whether it begins a new stream.

        It does if the last `new_stream_frames` rejected frames with its camera follow each other.
        """
        self._rejected.append(view)
        camera = view.intrinsics, view.depth_scale
        last = [each for each in self._rejected if (each.intrinsics, each.depth_scale) == camera]
        needed = LIMITS.new_stream_frames
        last = last[-needed:]
        return len(last) == needed and all(find_misfit(b, a) is None for a, b in pairwise(last))

    def begin(self, view: View, *, goes_on: bool) -> None:
        """Begin a new stream with a frame; the numbers of one that `goes_on` stay in order."""
        after = 0 if self._last is None else self._last.number + self._skip + 1
        self._skip = max(0, after - view.number) if goes_on else 0
        self._recent.clear()
        self._last = self._sparse = None

    def accept(self, view: View, received: float, clock: LiveStream | None) -> bool:
        """Keep a frame that fits. `clock` is the stream of another camera that lives, if there is one.

        Returns whether this frame shows that the camera's clock contradicts the offset in the rig file.
        """
        self._last, self.received, self.ended = view, received, False
        self._rejected.clear()
        self._recent.append((view.time_s, received))
        found = False
        if clock is not None:
            measured = clock.offset_s + clock.earliest - self.earliest
            found = not self.by_reception and abs(measured - self.offset_s) > LIMITS.clock_s
            self.by_reception |= found
            if self.by_reception:
                self.offset_s = measured
        self.waiting = replace(
            view,
            number=view.number + self._skip,
            time_s=view.time_s + self.offset_s,
            camera=self.camera.camera,
            T_rig_camera=self.camera.T_rig_camera,
        )
        return found

    @property
    def earliest(self) -> float:
        """The camera's time minus that of reception, of the frame that came with the least delay."""
        return max(time_s - received for time_s, received in self._recent)

    def take(self) -> View:
        """The frame that waits; gaps of sparse depth are closed."""
        view, self.waiting = self.waiting, None
        assert view is not None
        depth = measured(view.depth)
        if self._sparse is None and depth.any():
            self._sparse = is_sparse([depth])
        return replace(view, depth=close_gaps(depth) if self._sparse else depth)


def usual_step(values: Sequence[float]) -> float:
    """The median difference of successive values; infinite if there are not two."""
    return median(b - a for a, b in pairwise(values)) if len(values) > 1 else math.inf


def find_misfit(view: View, last: View) -> tuple[str, str] | None:
    """Why a frame cannot follow another one: the cause and a message; None if it can."""
    camera, other = view.intrinsics, last.intrinsics
    if (camera.width, camera.height) != (other.width, other.height):
        return "size", f"is {camera.width}x{camera.height}, those before {other.width}x{other.height}"
    if camera != other:
        return "intrinsics", "has other intrinsics than those before"
    if view.depth_scale != last.depth_scale:
        return "scale", f"has {view.depth_scale:g} units per metre, those before {last.depth_scale:g}"
    if view.number <= last.number or view.time_s <= last.time_s:
        before = f"the one before number {last.number} of {last.time_s:g} s"
        return ORDER, f"is number {view.number} of {view.time_s:g} s, {before}"
    return None
