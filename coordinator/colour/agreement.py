"""Whether a camera's colour shows people where its depth does: it may be unregistered, or of another time.

Robust residuals withstand single wrong keypoints and frames. Colour that shows people persistently elsewhere
is not used until it agrees again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.frame import Frame
from gepf.coordinator.colour.matching import EXCHANGED, ExpectedBody, Keypoints, distance_of
from gepf.coordinator.settings import ColourSettings

REMEDY = "is it registered to depth, and taken at the same time? --no-color uses depth alone"


@dataclass(frozen=True, slots=True)
class ColourState:
    """Whether the colour of a camera is used.

    against_s: seconds of disagreement less those of agreement, from 0 to `persistent_s`. since_s: time of the
    frame in which the use last ended or began. agreed_s: time of the last frame in which colour showed a
    person where depth does.
    """

    against_s: float = 0.0
    used: bool = True
    since_s: float | None = None
    agreed_s: float | None = None

    def after(
        self, against: Sequence[bool], interval_s: float, time_s: float, settings: ColourSettings
    ) -> Self:
        """The state after a frame; `against`: whether keypoints contradict a pose that explains depth."""
        if not against:
            return self
        balance = (2 * sum(against) - len(against)) / len(against)
        against_s = self.against_s + balance * min(interval_s, settings.max_step_s)
        against_s = min(max(against_s, 0.0), settings.persistent_s)
        used = against_s < settings.persistent_s if self.used else against_s == 0.0
        return type(self)(
            against_s,
            used,
            self.since_s if used == self.used else time_s,
            self.agreed_s if all(against) else time_s,
        )


ColourStates = dict[str, ColourState]
"""By the camera's name."""


def compare(
    states: ColourStates,
    frame: Frame,
    bodies: Sequence[ExpectedBody | None],
    seen: Sequence[Keypoints],
    interval_s: float,
    settings: ColourSettings,
) -> ColourStates:
    """The states after a frame in which these keypoints of people were seen.

    `bodies` are in the poses of the frame; None for those that depth does not explain.
    """
    after = dict(states)
    for view in frame.views:
        against = [
            are_elsewhere(body.pixels(view), keypoints[view.camera], settings)
            for body, keypoints in zip(bodies, seen, strict=True)
            if body is not None and view.camera in keypoints
        ]
        if against:
            before = states.get(view.camera, ColourState())
            after[view.camera] = before.after(against, interval_s, frame.time_s, settings)
    return after


def are_elsewhere(pixels: Array, keypoints: NDArray[np.float32], settings: ColourSettings) -> bool:
    """Whether keypoints are not where a body has them, at `pixels` (17, 2), or are all shifted.

    Which way the body faces does not matter. Clothes shift keypoints, too, but less. The pose follows a
    larger shift half of the way.
    """
    sides = keypoints, keypoints[EXCHANGED]
    keypoints = min(sides, key=lambda shown: distance_of(pixels, shown))
    off = (keypoints[:, :2] - pixels) * np.sqrt(keypoints[:, 2:])
    shift = float(np.linalg.norm(np.median(off, axis=0)))
    farthest = settings.same_person_deviations
    return shift > settings.shifted_deviations or distance_of(pixels, keypoints) > farthest


def unused(states: ColourStates) -> frozenset[str]:
    """The cameras whose colour is not used."""
    return frozenset(name for name, state in states.items() if not state.used)


def unused_before(states: ColourStates, time_s: float | None) -> frozenset[str]:
    """The cameras whose colour was not used before the frame at this time; later changes do not count."""

    def was_used(state: ColourState) -> bool:
        has_changed = time_s is not None and state.since_s is not None and state.since_s >= time_s
        return state.used != has_changed

    return frozenset(name for name, state in states.items() if not was_used(state))


def trusted(states: ColourStates, time_s: float, settings: ColourSettings) -> frozenset[str]:
    """The cameras whose colour shows people now: it is used, and has lately shown somebody where depth does.

    Colour of the others, for example in the dark, is no sign that nobody is there.
    """
    return frozenset(
        name
        for name, state in states.items()
        if state.used and state.agreed_s is not None and time_s - state.agreed_s <= settings.persistent_s
    )


def describe_changes(before: Mapping[str, ColourState], now: Mapping[str, ColourState]) -> list[str]:
    """Messages about the cameras whose colour is no longer used, or is used again."""
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
