"""Whether a camera's colour shows people where its depth does: it may be unregistered, or of another time.

Robust residuals withstand single wrong keypoints and frames. Colour that shows people persistently elsewhere
is not used until it agrees again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from gepf.common.frame import DepthFrame
from gepf.coordinator.colour.finder import SAME_PERSON, ExpectedBody, Keypoints, distance_of, in_view

PERSISTENT_S = 4.0  # by which disagreement outlasts agreement until colour is not used; and the reverse
LONGEST_STEP_S = 0.5  # between two frames, that counts
REMEDY = "is it registered to depth, and taken at the same time? --no-color uses depth alone"


@dataclass(frozen=True, slots=True)
class ColourState:
    """Whether the colour of a camera is used.

    against_s: seconds of disagreement less those of agreement, from 0 to PERSISTENT_S. since_s: time of the
    frame in which the use ended or began.
    """

    against_s: float = 0.0
    used: bool = True
    since_s: float = 0.0

    def after(self, distances: Sequence[float], interval_s: float, time_s: float) -> Self:
        """The state after a frame; distances of keypoints from bodies that depth explains, in deviations."""
        if not distances:
            return self
        apart = sum(1.0 if distance > SAME_PERSON else -1.0 for distance in distances) / len(distances)
        against_s = self.against_s + apart * min(interval_s, LONGEST_STEP_S)
        against_s = min(max(against_s, 0.0), PERSISTENT_S)
        used = against_s < PERSISTENT_S if self.used else against_s == 0.0
        return type(self)(against_s, used, self.since_s if used == self.used else time_s)


ColourStates = dict[str, ColourState]
"""By the camera's name."""


def compare(
    states: ColourStates,
    frame: DepthFrame,
    bodies: Sequence[ExpectedBody | None],
    found: Sequence[Keypoints],
    interval_s: float,
) -> ColourStates:
    """The states after a frame with `found` keypoints of people.

    `bodies` are in the poses of the frame; None for those that depth does not explain.
    """
    after = dict(states)
    for view in frame.views:
        distances = [
            distance_of(in_view(body, view), keypoints[view.camera])
            for body, keypoints in zip(bodies, found, strict=True)
            if body is not None and view.camera in keypoints
        ]
        if distances:
            before = states.get(view.camera, ColourState())
            after[view.camera] = before.after(distances, interval_s, frame.time_s)
    return after


def unused(states: ColourStates) -> frozenset[str]:
    """The cameras whose colour is not used."""
    return frozenset(name for name, state in states.items() if not state.used)


def describe_changes(before: Mapping[str, ColourState], now: Mapping[str, ColourState]) -> list[str]:
    """Messages on the cameras whose colour is not used any more, or used again."""
    lines = list[str]()
    for name, state in now.items():
        if state.used != before.get(name, ColourState()).used:
            which = f"colour of camera {name}" if name else "colour"
            lines.append(
                f"{which} agrees with depth again, and is used"
                if state.used
                else f"{which} shows people elsewhere than depth, and is not used until it agrees; {REMEDY}"
            )
    return lines
