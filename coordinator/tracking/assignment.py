"""Which pixels of a segmented frame are whose: those around a pose, or a candidate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import SubjectFrame
from gepf.coordinator.tracking.observation import middle_of
from gepf.coordinator.tracking.segmenter import BodyView, SegmentedFrame, Segmenter, UntrackedPerson
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import Body, Found, Searching


class Assignment:
    """Assigns the pixels of one segmented frame to people.

    Of its candidates, those in `free` may be somebody, the most likely first; each only once. `view_of` is
    called for people in their order, each after the person before was submitted: a person who was detected
    just now is a body then.
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
        detected = any(
            isinstance(target.track, Found) and target.track.place is not None for target in targets
        )
        self._free = [] if detected else list(free)

    def view_of(self, place: int) -> BodyView:
        """What shows a person: a free candidate if the person is undetected or lost."""
        segmented, target, is_elsewhere = self._segmented, self._targets[place], False
        subject, alternatives = segmented.subjects[place], tuple[SubjectFrame, ...]()
        if not isinstance(target.track, Body):
            subject, candidate = None, self._for_search(place)
        elif target.needs_candidates:
            subject, candidate = None, self._take(nearest(self._free, target.last_seen))
        else:
            candidate = self._take(self._elsewhere(place)) if self._misses(place) else None
            is_elsewhere = candidate is not None and not isinstance(target.track, Found)
        if candidate is not None:
            subject, alternatives = candidate.subject, candidate.alternatives
        planes, excluded = segmented.planes(subject), segmented.excluded[place]
        return BodyView(segmented.frame, subject, planes, alternatives, excluded, is_elsewhere)

    def _take(self, candidate: UntrackedPerson | None) -> UntrackedPerson | None:
        """The same candidate, who is nobody else from now on."""
        if candidate in self._free:
            self._free.remove(candidate)
        return candidate

    def _for_search(self, place: int) -> UntrackedPerson | None:
        """The candidate in which a person is searched for: the one under way, or each in turn.

        If colour shows people, only they have turns.

        People are detected in their order. In the first round all cameras of a candidate are used, in each
        further round one of them: cameras with wrong poses show no person together.
        """
        target = self._targets[place]
        shown = [who for who in self._free if who.is_shown]
        possible = (shown or self._free)[: 1 if len(self._targets) == 1 else None]
        count = len(possible)
        if not count or not all(isinstance(before.track, Body) for before in self._targets[:place]):
            return None
        search = 0
        if isinstance(target.track, Searching):
            is_due = target.track.is_due(self._segmented.frame.time_s, target.policy.settings)
            search = target.track.searches - (not is_due)
        rounds, turn = divmod(search, count)
        chosen = possible[turn]
        if target.search.person is not None:
            chosen = nearest(self._free, middle_of(target.search.person.subject)) or chosen
        self._take(chosen)
        views = chosen.subject.views
        by_camera = [UntrackedPerson(replace(chosen.subject, views=(view,))) for view in views]
        options = [chosen, *by_camera] if len(views) > 1 else [chosen]
        return options[rounds % len(options)]

    def _misses(self, place: int) -> bool:
        """Whether so few pixels of the body are visible that it is looked for elsewhere."""
        target, pixels = self._targets[place], self._segmented.pixels(place)
        if isinstance(target.track, Found):
            whole = target.policy.settings.whole_share * target.track.detected_pixels
        else:
            assert isinstance(target.track, Body)
            whole = max(target.policy.min_points, target.policy.settings.gone_share * target.track.pixels)
        return pixels < whole and target.policy.recovers

    def _elsewhere(self, place: int) -> UntrackedPerson | None:
        """A candidate nearby with more pixels than the present subject, who is probably the same person.

        The frame has no candidates of its own unless a body may be anywhere, so they are looked for now.
        """
        target, pixels = self._targets[place], self._segmented.pixels(place)
        surfaces = [other.segmentation_surface() for n, other in enumerate(self._targets) if n != place]
        candidates = self._segmenter.find_candidates(
            self._segmented, [surface for surface in surfaces if surface is not None]
        )
        if isinstance(target.track, Found) and target.track.place is not None:
            candidate, near = nearest(candidates, target.track.place), True
        else:
            candidate = next(iter(candidates), None)
            near = (
                candidate is not None
                and distance(candidate.subject, target.last_seen) < target.policy.settings.max_motion_m
            )
        if candidate is None or candidate.subject.pixels <= pixels:
            return None
        return candidate if near or pixels < target.policy.min_points else None

    def people_beside(self, place: int, searched: UntrackedPerson) -> list[SubjectFrame]:
        """All people in the frame except the one at this place, who was searched for as `searched`."""
        candidates = [candidate.subject for candidate in self._segmented.candidates]
        beside = [subject for subject in candidates if subject is not searched.subject]
        return beside + [
            subject for n, subject in enumerate(self._segmented.subjects) if subject and n != place
        ]


def nearest(candidates: Sequence[UntrackedPerson], place: Array) -> UntrackedPerson | None:
    """The candidate that is nearest to a place (3,), metres; None without candidates."""
    return min(candidates, key=lambda candidate: distance(candidate.subject, place), default=None)


def distance(subject: SubjectFrame, place: Array) -> float:
    """Distance in metres from the median of a person's observed points to a place (3,)."""
    return float(np.linalg.norm(middle_of(subject) - place))
