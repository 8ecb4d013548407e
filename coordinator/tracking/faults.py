"""The faults of the cameras of a rig, what they agree on, and how this is reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Kind = Literal["gives no depth", "repeats an image", "contradicts the others"]

NO_DEPTH: Kind = "gives no depth"
REPEATS: Kind = "repeats an image"
CONTRADICTS: Kind = "contradicts the others"
CONFIRMED_S = 0.5  # until a fault is reported, and until cameras that agree are believed
REMEDY = "it or another one was moved: gepf calibrate finds the poses again from recordings"


@dataclass(frozen=True, slots=True)
class CameraState:
    """A camera after a frame."""

    image: int  # checksum of a part of its last image
    good_s: float  # time of the last frame without a fault
    fault: Kind | None = None


CameraStates = dict[str, CameraState]
"""By the camera's name."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether the cameras that show a body agree on its place.

    contradicting: cameras whose points the last pose does not explain. agreed_s: seconds for which two or
    more cameras agree; kept from CONFIRMED_S on, until the body is lost.
    """

    contradicting: tuple[str, ...] = ()
    agreed_s: float = 0.0

    def dispute(self, shown: Sequence[str]) -> str:
        """Why a pose by the cameras that are `shown` may be at a wrong place; empty if it is not.

        Of two cameras that contradict each other, one is believed only if they agreed before.
        """
        others = [name for name in shown if name not in self.contradicting]
        if not self.contradicting or len(others) > 1 or (others and self.agreed_s >= CONFIRMED_S):
            return ""
        against = ", ".join(others) or "the others"
        return f"{', '.join(self.contradicting)} contradicts {against}: either may have a wrong T_rig_camera"


def faults_of(states: Mapping[str, CameraState], time_s: float) -> dict[str, tuple[Kind, float]]:
    """The lasting faults of cameras at the time of a frame, each with its start."""
    return {
        name: (state.fault, state.good_s)
        for name, state in states.items()
        if state.fault is not None and time_s - state.good_s >= CONFIRMED_S
    }


def describe_changes(
    before: Mapping[str, tuple[Kind, float]], now: Mapping[str, tuple[Kind, float]]
) -> list[str]:
    """Messages on the faults that were found since another frame, and on those that have ended."""
    found = [
        f"camera {name} {kind} since {since:.2f} s"
        + (f" and is left out; {REMEDY}" if kind == CONTRADICTS else "")
        for name, (kind, since) in now.items()
        if name not in before or before[name][0] != kind
    ]
    return found + [f"camera {name} is used again" for name in before if name not in now]
