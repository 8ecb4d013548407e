"""What of a scene is tracked: what counts, who is meant, and what is known of the room before."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from coordinator.scene.limits import Limits
from coordinator.scene.people.person import Person


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
