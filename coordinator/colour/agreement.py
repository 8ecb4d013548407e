"""Whether a camera's colour shows people where its depth does: it may be unregistered, or of another time.

Robust residuals withstand single wrong keypoints and frames. Colour that shows people persistently elsewhere
is not used until it agrees again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.frame import Frame, SubjectFrame, SubjectView
from gepf.coordinator.colour.matching import EXCHANGED, ExpectedBody, Keypoints, are_on, distance_of
from gepf.coordinator.settings import ColourSettings

Verdict = Literal["agrees", "another pose", "elsewhere"]
"""Where colour shows a person: at the body; only on the body's pixels, so the pose is wrong; elsewhere."""

REMEDY = "is it registered to depth, and taken at the same time? --no-color uses depth alone"


@dataclass(frozen=True, slots=True)
class ColourState:
    """Whether the colour of a camera is used.

    against_s: seconds of disagreement less those of agreement, from 0 to `persistent_s`. since_s: time of the
    frame in which the use last ended or began. agreed_s: time of the last frame in which colour showed a
    person where depth has a body or a candidate.
    """

    against_s: float = 0.0
    used: bool = True
    since_s: float | None = None
    agreed_s: float | None = None

    def after(
        self, verdicts: Sequence[Verdict], interval_s: float, time_s: float, settings: ColourSettings
    ) -> Self:
        """The state after a frame in which the keypoints of these people were compared with depth."""
        against, agreeing = verdicts.count("elsewhere"), verdicts.count("agrees")
        balance = (against - agreeing) / len(verdicts)
        against_s = self.against_s + balance * min(interval_s, settings.max_step_s)
        against_s = min(max(against_s, 0.0), settings.persistent_s)
        used = against_s < settings.persistent_s if self.used else against_s == 0.0
        return type(self)(
            against_s,
            used,
            self.since_s if used == self.used else time_s,
            self.agreed_s if against == len(verdicts) else time_s,
        )


ColourStates = dict[str, ColourState]
"""By the camera's name."""


def compare(
    states: ColourStates,
    frame: Frame,
    bodies: Sequence[ExpectedBody | None],
    subjects: Sequence[SubjectFrame | None],
    seen: Sequence[Keypoints],
    interval_s: float,
    settings: ColourSettings,
) -> ColourStates:
    """The states of the cameras after a frame in which these keypoints of people were seen.

    `bodies` are in the poses of the frame; None for those that depth does not explain. `subjects` are their
    pixels.
    """
    after = dict(states)
    images = {view.camera: view for view in frame.views}
    compared = dict[str, list[Verdict]]()
    for body, subject, keypoints in zip(bodies, subjects, seen, strict=True):
        if body is None or subject is None:
            continue
        for view in subject.views:
            camera = view.image.camera
            if camera in keypoints:
                verdict = judge(body.pixels(images[camera]), keypoints[camera], view, settings)
                compared.setdefault(camera, []).append(verdict)
    for camera, verdicts in compared.items():
        before = states.get(camera, ColourState())
        after[camera] = before.after(verdicts, interval_s, frame.time_s, settings)
    return after


def with_agreement(states: ColourStates, cameras: Collection[str], time_s: float) -> ColourStates:
    """The states after a frame in which these cameras showed people, in colour, on candidates of depth."""
    return states | {
        name: replace(states.get(name, ColourState()), agreed_s=time_s) for name in sorted(cameras)
    }


def judge(
    pixels: Array, keypoints: NDArray[np.float32], view: SubjectView, settings: ColourSettings
) -> Verdict:
    """Where keypoints (17, 3) show a person whose pixels are those of `view`.

    The body has its keypoints at `pixels` (17, 2) of the image. Keypoints are elsewhere if the body is on the
    person's pixels and all of them are shifted by the same amount, or if they are neither at the body nor on
    these pixels. If they are on the pixels, the pose is wrong. Which way the body faces does not matter.
    Clothes shift keypoints, too, but less. The pose follows a larger shift half of the way.
    """
    sides = keypoints, keypoints[EXCHANGED]
    nearest = min(sides, key=lambda shown: distance_of(pixels, shown))
    shift = np.median(nearest[:, :2] - pixels, axis=0)
    is_shifted = np.linalg.norm(shift) * np.sqrt(np.median(nearest[:, 2])) > settings.shifted_deviations
    fits_shifted = distance_of(pixels + shift, nearest) <= settings.shifted_deviations
    if (
        is_shifted
        and fits_shifted
        and are_on(view, np.column_stack([pixels, nearest[:, 2]]), settings.outline_px)
    ):
        return "elsewhere"
    if distance_of(pixels, nearest) <= settings.same_person_deviations:
        return "agrees"
    return "another pose" if are_on(view, keypoints, settings.outline_px) else "elsewhere"


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
