"""Assigns the pixels of a segmented frame to people: those around a pose, or those of a candidate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import SubjectFrame
from gepf.coordinator.colour.clothes import clothes_in
from gepf.coordinator.tracking.observation import median_point
from gepf.coordinator.tracking.reidentification import SeenCandidate, assign_lost
from gepf.coordinator.tracking.segmenter import BodyView, SegmentedFrame, Segmenter, UntrackedPerson
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import Body, Found, Searching


class Assignment:
    """Assigns the pixels of one segmented frame to people.

    `free` are the candidates that may still be assigned, most likely first; each is assigned at most once,
    first to the lost bodies. `view_of` is called for each person in turn, after the previous person has been
    submitted, so the track of a person who has just been detected is already a `Body`.
    """

    def __init__(
        self,
        targets: Sequence[TargetTracker],
        segmenter: Segmenter,
        segmented: SegmentedFrame,
        free: Sequence[UntrackedPerson],
    ) -> None:
        self._targets, self._segmenter, self._segmented = targets, segmenter, segmented
        # a person who has just been detected may still be among the candidates
        self._free = [] if any(target.is_just_detected for target in targets) else list(free)
        self._returned = self._assign_lost()

    def view_of(self, person_index: int) -> BodyView:
        """What the frame shows of a person: their own pixels, nothing for a duplicate, or else a candidate.

        People who are undetected or lost get a free candidate, if there is one; a body that is mostly missing
        may get one found elsewhere.
        """
        segmented, target = self._segmented, self._targets[person_index]
        is_elsewhere = False
        subject = segmented.subjects[person_index]
        if not isinstance(target.track, Body):
            subject, candidate = None, self._candidate_to_search(person_index)
        elif segmented.duplicates[person_index] and not target.is_just_detected:
            subject, candidate = None, None
        elif target.needs_candidates:
            subject, candidate = None, self._returned.get(person_index)
        else:
            candidate = (
                self._candidate_elsewhere(person_index) if self._is_mostly_missing(person_index) else None
            )
            is_elsewhere = candidate is not None and not isinstance(target.track, Found)
        if candidate is not None:
            subject = candidate.subject
        planes, set_aside = segmented.planes(subject), segmented.set_aside[person_index]
        return BodyView(
            segmented.frame,
            subject,
            planes,
            candidate,
            set_aside,
            is_own=candidate is None,
            is_duplicate=segmented.duplicates[person_index],
            is_elsewhere=is_elsewhere,
        )

    def _assign_lost(self) -> dict[int, UntrackedPerson]:
        """The candidates of the lost bodies, which are then no longer free, by the body's index.

        Candidates that colour confirms come first. A candidate in which a search for somebody undetected is
        running is left to them.
        """
        lost = {n: t for n, t in enumerate(self._targets) if isinstance(t.track, Body) and t.needs_candidates}
        if not lost:
            return {}
        undetected = [target for target in self._targets if not isinstance(target.track, Body)]
        searched = [
            nearest(self._free, median_point(person.subject))
            for target in undetected
            if (person := target.searched_person) is not None
        ]
        possible = confirmed_or_all([candidate for candidate in self._free if candidate not in searched])
        frame = self._segmented.frame
        returned = assign_lost(
            [target.lost_body(frame.time_s) for target in lost.values()],
            [
                SeenCandidate(median_point(candidate.subject), clothes_in(frame, candidate.subject))
                for candidate in possible
            ],
            self._targets[0].policy,
            may_refuse=bool(undetected),
        )
        assigned = {person: possible[n] for person, n in zip(lost, returned, strict=True) if n is not None}
        for candidate in assigned.values():
            self._free.remove(candidate)
        return assigned

    def _candidate_to_search(self, person_index: int) -> UntrackedPerson | None:
        """The candidate to search: that of the search under way, otherwise each candidate in turn.

        If colour confirms some candidates as people, only those are searched.

        People are detected one after another, in the order of their numbers. In the first round all cameras
        of a candidate are used, in each further round only one of them: the views of cameras with wrong poses
        do not combine into a person.
        """
        target = self._targets[person_index]
        possible = confirmed_or_all(self._free)[: 1 if len(self._targets) == 1 else None]
        count = len(possible)
        if not count or not all(isinstance(earlier.track, Body) for earlier in self._targets[:person_index]):
            return None
        search_number = 0
        if isinstance(target.track, Searching):
            is_due = target.track.is_due(self._segmented.frame.time_s, target.policy.settings)
            search_number = target.track.searches if is_due else target.track.searches - 1
        round_number, turn = divmod(search_number, count)
        chosen = possible[turn]
        if (person := target.searched_person) is not None:
            chosen = nearest(self._free, median_point(person.subject)) or chosen
        self._free.remove(chosen)
        options = [chosen, *chosen.by_camera()] if len(chosen.subject.views) > 1 else [chosen]
        return options[round_number % len(options)]

    def _is_mostly_missing(self, person_index: int) -> bool:
        """Whether so few pixels of the body are visible that it is looked for elsewhere."""
        target, pixels = self._targets[person_index], self._segmented.pixels(person_index)
        if isinstance(target.track, Found):
            min_pixels = target.policy.settings.whole_share * target.track.detected_pixels
        else:
            assert isinstance(target.track, Body)
            min_pixels = max(
                target.policy.min_points, target.policy.settings.gone_share * target.track.pixels
            )
        return pixels < min_pixels and target.policy.recovers

    def _candidate_elsewhere(self, person_index: int) -> UntrackedPerson | None:
        """A candidate that has more pixels than the present subject and is probably the same person, or None.

        It must be near, unless the subject has too few pixels to show a body. Candidates are found here,
        because few frames come with candidates while all bodies are known.
        """
        target, pixels = self._targets[person_index], self._segmented.pixels(person_index)
        surfaces = [
            other.segmentation_surface() for n, other in enumerate(self._targets) if n != person_index
        ]
        candidates = self._segmenter.find_candidates(
            self._segmented, [surface for surface in surfaces if surface is not None]
        )
        if isinstance(target.track, Found) and target.track.place is not None:
            candidate = nearest(candidates, target.track.place)
            near = True  # a detected body was seen recently: the nearest candidate counts, however far away
        else:
            candidate = next(iter(candidates), None)
            near = (
                candidate is not None
                and distance(candidate.subject, target.last_position) < target.policy.settings.max_motion_m
            )
        if candidate is None or candidate.subject.pixels <= pixels:
            return None
        return candidate if near or pixels < target.policy.min_points else None

    def other_people(self, person_index: int, searched: UntrackedPerson) -> list[SubjectFrame]:
        """All people in the frame except the person with this index, who was detected in `searched`."""
        candidates = [candidate.subject for candidate in self._segmented.candidates]
        other_candidates = [subject for subject in candidates if subject is not searched.subject]
        return other_candidates + [
            subject for n, subject in enumerate(self._segmented.subjects) if subject and n != person_index
        ]


def confirmed_or_all(candidates: list[UntrackedPerson]) -> list[UntrackedPerson]:
    """The candidates that colour confirms as people; all of them if it confirms none."""
    return [candidate for candidate in candidates if candidate.is_confirmed] or candidates


def nearest(candidates: Sequence[UntrackedPerson], position: Array) -> UntrackedPerson | None:
    """The candidate nearest to a position (3,), metres; None without candidates."""
    return min(candidates, key=lambda candidate: distance(candidate.subject, position), default=None)


def distance(subject: SubjectFrame, position: Array) -> float:
    """Distance in metres from the median of a person's observed points to a position (3,)."""
    return float(np.linalg.norm(median_point(subject) - position))
