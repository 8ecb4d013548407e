"""What of a scene is tracked: what counts, who is meant, and what is known of the room before."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame
from coordinator.scene.candidates import Person


@dataclass(frozen=True, slots=True)
class Limits:
    """Metres, and left, top, right and bottom in pixels, half-open; None for no limit."""

    near: float | None = None
    far: float | None = None
    region: tuple[int, int, int, int] | None = None

    def keep(self, frame: DepthFrame) -> DepthFrame:
        """The frame, in which nothing else was measured; the same one without limits."""
        return self.split(frame)[0]

    def split(self, frame: DepthFrame) -> tuple[DepthFrame, NDArray[np.bool_] | None]:
        """What `keep` and `leave_out` give."""
        left_out = self.leave_out(frame)
        if left_out is None:
            return frame, None
        return replace(frame, depth=np.where(left_out, np.uint16(0), frame.depth)), left_out

    def leave_out(self, frame: DepthFrame) -> NDArray[np.bool_] | None:
        """Pixels (H, W) that do not count, measured or not; None without limits."""
        if self == Limits():
            return None
        depth = frame.metres()
        left_out = np.zeros(depth.shape, dtype=np.bool_)
        if self.near is not None:
            left_out |= (depth > 0.0) & (depth < self.near)
        if self.far is not None:
            left_out |= depth > self.far
        if self.region is not None:
            left, top, right, bottom = self.region
            inside = np.zeros_like(left_out)
            inside[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = True
            left_out |= ~inside
        return left_out


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """What of the frames counts, who is meant where there are several, and the room without anybody.

    background: depth (H, W) in metres, 0 where that is not known; None to learn it all.
    up: Unit vector (3,) away from the ground, camera frame, where the recording or the user says so.
    """

    limits: Limits = field(default_factory=Limits)
    person: Person = field(default_factory=Person)
    background: NDArray[np.float32] | None = None
    up: NDArray[np.float64] | None = None

    def describe(self) -> dict[str, object]:
        """All of it by name, as JSON can hold it; of the background a hash."""
        empty = self.background
        return {
            "person": self.person.way if self.person.pixel is None else list(self.person.pixel),
            "near": self.limits.near,
            "far": self.limits.far,
            "roi": None if self.limits.region is None else list(self.limits.region),
            "background": None if empty is None else hashlib.sha256(empty.tobytes()).hexdigest()[:12],
            "up": None if self.up is None else self.up.tolist(),
        }


def up_in_picture(turn: float) -> NDArray[np.float64]:
    """Up (3,) in the frame of a camera whose picture has to be turned by so much, radians, to be upright."""
    return np.array([-np.sin(turn), -np.cos(turn), 0.0])
