"""What colour reveals in each frame: where people are, which candidates are people, and which side is left.

Keypoints are found while depth is segmented, a frame ahead. `ColouredFrame` decides whether they are used,
from the states of the cameras after the previous frame.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame, SubjectFrame
from gepf.coordinator.colour.agreement import ColourStates, trusted, unused
from gepf.coordinator.colour.finder import KeypointFinder, PeopleInColour
from gepf.coordinator.colour.matching import (
    ExpectedBody,
    Keypoints,
    with_keypoints,
    with_sides_of,
    without_keypoints,
)
from gepf.coordinator.colour.motion import trunk_step
from gepf.coordinator.settings import ColourSettings
from gepf.coordinator.tracking.segmenter import BodyView, SegmentedFrame, UntrackedPerson
from gepf.coordinator.tracking.track_state import ROUNDING_S


class KeypointScheduler:
    """Starts the search for keypoints in each frame that has colour; without a finder, in none.

    While live frames are late, it looks at colour only every `late_look_s` seconds, and counts the frames
    left out.
    """

    def __init__(self, finder: KeypointFinder | None, settings: ColourSettings) -> None:
        self._finder, self._settings = finder, settings
        self._looked_s = -math.inf

    def begin(
        self, frame: Frame, bodies: Sequence[ExpectedBody | None], *, is_late: bool
    ) -> KeypointSearch | None:
        """Begin to search for keypoints around the expected bodies; None if the frame is not searched."""
        finder, settings = self._finder, self._settings
        if finder is None:
            return None
        if any(bodies) and is_late and frame.time_s < self._looked_s + settings.late_look_s - ROUNDING_S:
            finder.left_out += 1
            return None
        self._looked_s = frame.time_s
        return KeypointSearch(frame, bodies, finder, finder.submit(frame, bodies, settings), settings)


@dataclass(frozen=True, slots=True, eq=False)
class KeypointSearch:
    """The search for people in the colour of a frame, under way on another thread."""

    frame: Frame
    bodies: Sequence[ExpectedBody | None]
    finder: KeypointFinder
    people: Future[PeopleInColour]
    settings: ColourSettings

    def steps(self, is_usable: Sequence[bool], max_motion_m: float) -> list[Array | None]:
        """The motion (3,) of each body since its last pose, metres; None if its keypoints are not usable."""
        bodies, keypoints = self.bodies, self.people.result().keypoints
        return [
            trunk_step(body, own, self.frame, max_motion_m, self.settings)
            if body is not None and usable
            else None
            for body, own, usable in zip(bodies, keypoints, is_usable, strict=True)
        ]

    def detections(
        self,
        segmented: SegmentedFrame,
        steps: Sequence[Array | None],
        interval_s: float,
        *,
        finds_candidates: bool,
    ) -> KeypointDetections:
        """What the segmented frame shows: people, and, with `finds_candidates`, some candidates."""
        people = self.people.result()
        candidates = self.candidates(segmented, interval_s) if finds_candidates else {}
        return KeypointDetections(people, candidates, steps)

    def candidates(self, segmented: SegmentedFrame, interval_s: float) -> dict[int, Keypoints]:
        """The keypoints of some candidates, by the candidate's index.

        The candidates are drawn at random, as many as the time `interval_s` since the previous frame allows.
        In the first frame, all candidates are looked at.
        """
        candidates, count = segmented.candidates, len(segmented.candidates)
        if interval_s > 0.0:
            count = max(1, round(self.settings.looks_per_s * interval_s))
        drawn = draw_candidates(self.frame.number, len(candidates), count)
        chosen = {n: (candidates[n].subject, candidates[n].widest) for n in drawn}
        upward = {view.image.camera: view.scene.planes.up for view in segmented.views}
        return self.finder.look_at(chosen, self.frame, upward, self.settings)


@dataclass(frozen=True, slots=True, eq=False)
class KeypointDetections:
    """What the keypoint network found in a frame.

    candidates: keypoints of the candidates that were looked at, by index. steps: the motion (3,) of each
    person since the last pose, metres; None if unknown.
    """

    people: PeopleInColour
    candidates: Mapping[int, Keypoints]
    steps: Sequence[Array | None]

    @classmethod
    def of_nobody(cls, count: int) -> KeypointDetections:
        """The detections in a frame that is not searched, for this number of people."""
        return cls(PeopleInColour([{}] * count, [()] * count), {}, [None] * count)


class ColouredFrame:
    """A segmented frame with the keypoints that are used.

    A camera whose keypoints contradict depth contributes none.

    `oriented_bodies` are the bodies whose left and right side are known: swapped keypoints are swapped back.

    Attributes:
        segmented: The frame; its subjects and candidates have their keypoints.
        free: The candidates that may be assigned to somebody, the most likely first.
    """

    def __init__(
        self,
        segmented: SegmentedFrame,
        detections: KeypointDetections,
        states: ColourStates,
        oriented_bodies: Sequence[ExpectedBody | None],
        settings: ColourSettings,
    ) -> None:
        self._detections, self._distrusted = detections, unused(states)
        coloured = {view.camera for view in segmented.frame.views if view.colours is not None}
        self._trusted_cameras = coloured & trusted(states, segmented.frame.time_s, settings)
        before = [
            without_keypoints(subject, self._distrusted) if subject and self._distrusted else subject
            for subject in segmented.subjects
        ]
        subjects = [
            with_sides_of(subject, body, settings) if subject and body else subject
            for subject, body in zip(before, oriented_bodies, strict=True)
        ]
        # `with_sides_of` returns the same object unless it swaps
        self._is_swapped = [sided is not own for sided, own in zip(subjects, before, strict=True)]
        people = [
            candidate.with_keypoints(
                {
                    camera: keypoints
                    for camera, keypoints in detections.candidates.get(n, {}).items()
                    if camera not in self._distrusted
                }
            )
            for n, candidate in enumerate(segmented.candidates)
        ]
        self.segmented = replace(segmented, subjects=tuple(subjects), candidates=tuple(people))
        self.free = possible_people(people, self._trusted_cameras)

    def complete(self, view: BodyView, person_index: int, *, is_at_last_pose: bool) -> BodyView:
        """The view of the body with this index, with what colour reveals about it."""
        if view.subject is None or not view.is_own:
            return view
        looked_in = self._trusted_cameras.intersection(self._detections.people.looked_in[person_index])
        return replace(
            view,
            motion_m=self._detections.steps[person_index] if is_at_last_pose else None,
            is_looked_at=any(own.image.camera in looked_in for own in view.subject.views),
            is_swapped=self._is_swapped[person_index],
        )


def possible_people(
    candidates: Sequence[UntrackedPerson], trusted_cameras: Collection[str]
) -> list[UntrackedPerson]:
    """Candidates confirmed by colour (those with keypoints), followed by the others.

    The others are left out if they are in the image of one of the `trusted_cameras`.
    """
    confirmed, unconfirmed = list[UntrackedPerson](), list[UntrackedPerson]()
    for candidate in candidates:
        if candidate.is_confirmed:
            confirmed.append(candidate)
        elif all(view.image.camera not in trusted_cameras for view in candidate.subject.views):
            unconfirmed.append(candidate)
    return confirmed + unconfirmed


def draw_candidates(number: int, count: int, turns: int) -> list[int]:
    """The candidates drawn in the frame with this number: at most `turns` of `count`.

    They are drawn at random, so that no candidate waits for ever, however the frames are numbered.
    """
    return [int(n) for n in np.random.default_rng(number).permutation(count)[:turns]]


def with_own_keypoints(segmented: SegmentedFrame, keypoints: Sequence[Keypoints]) -> SegmentedFrame:
    """The frame with each subject's keypoints added."""
    subjects: list[SubjectFrame | None] = [
        with_keypoints(subject, own) if subject else None
        for subject, own in zip(segmented.subjects, keypoints, strict=True)
    ]
    return replace(segmented, subjects=tuple(subjects))
