"""Prepares a frame: compares its cameras, segments it around the people, and looks at them in colour.

A frame may be prepared while the workers refine the one before it. The state kept here is therefore that of
the last prepared frame, which may be one frame ahead of the tracker's state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gepf.common.frame import Frame
from gepf.coordinator.colour.agreement import ColourStates, unused_before
from gepf.coordinator.settings import TrackSettings
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import CameraStates, watch
from gepf.coordinator.tracking.colour import ColourWatch, Look, Sight, with_own_keypoints
from gepf.coordinator.tracking.segmenter import ExpectedSurface, SegmentedFrame, Segmenter
from gepf.coordinator.tracking.state import FrameState
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import ROUNDING_S, Body, Searching


@dataclass(frozen=True, slots=True, eq=False)
class PreparedFrame:
    """A segmented frame, the state of its cameras, what colour shows, and a stopwatch for each person.

    interval_s: time since the previous frame, seconds; 0 for the first. after_gap: whether that time exceeds
    `max_lookahead_s`; the next frame is then prepared only after the update, around newer poses.
    """

    segmented: SegmentedFrame
    cameras: CameraStates
    after_gap: bool
    clocks: Sequence[Stopwatch]
    sight: Sight
    interval_s: float


class FramePreparation:
    """Prepares frames in order; `state` is the state after the last frame."""

    def __init__(
        self, segmenter: Segmenter, colour: ColourWatch, settings: TrackSettings, state: FrameState
    ) -> None:
        self._segmenter, self._colour, self._settings = segmenter, colour, settings
        self._cameras, self._time_s = state.cameras, state.time_s

    def prepare(
        self, frame: Frame, targets: Sequence[TargetTracker], colours: ColourStates, *, is_late: bool
    ) -> PreparedFrame:
        """The next frame, segmented around the people; `colours` are as of the last updated frame.

        First, the results of searches that have ended in the meantime are taken over. While frames are late,
        colour is looked at less often.
        """
        clocks = [Stopwatch() for _ in targets]
        for target in targets:
            target.take_search()
        with clocks[0].stage("segment"):
            expected = [target.next_segmentation for target in targets]
            excluded_by_any = set[str]().union(*(body.excluded for body in expected))
            self._cameras, frame = watch(self._cameras, frame, excluded_by_any)
            last_s, self._time_s = self._time_s, frame.time_s
            interval_s = 0.0 if last_s is None else frame.time_s - last_s
            after_gap = interval_s > self._settings.max_lookahead_s + ROUNDING_S
            look = self._colour.begin(frame, [target.expected_body for target in targets], is_late=is_late)
            sight = Sight.of_nobody(len(targets))
            # in twice the longest interval for looking ahead, people walk out of reach of their last pose
            if look is not None and interval_s > 2.0 * self._settings.max_lookahead_s + ROUNDING_S:
                # the last frame may be updated or not: either way, what was known before it counts
                is_trusted = not unused_before(colours, last_s)
                usable = [is_trusted and body.is_confirmed for body in expected]
                sight = replace(sight, steps=look.steps(usable, self._settings.max_motion_m))
            segmented = self._segmenter.segment(
                frame,
                [
                    ExpectedSurface(
                        target.segmentation_surface(step),
                        body.excluded,
                        body.is_new,
                        target.points_factor,
                        body.followed_s,
                    )
                    for target, step, body in zip(targets, sight.steps, expected, strict=True)
                ],
                rejected=any(
                    isinstance(target.track, Searching)
                    and target.track.searches > self._settings.max_searches
                    for target in targets
                ),
                find=any(target.needs_candidates for target in targets),
            )
        if look is not None:
            with clocks[0].stage("keypoints"):
                sight = finish_look(look, segmented, sight, targets, interval_s)
                segmented = with_own_keypoints(segmented, sight.people.keypoints)
        return PreparedFrame(segmented, self._cameras, after_gap, clocks, sight, interval_s)


def finish_look(
    look: Look, segmented: SegmentedFrame, sight: Sight, targets: Sequence[TargetTracker], interval_s: float
) -> Sight:
    """What a look at a segmented frame shows: people, and candidates if somebody is searched for."""
    people, time_s = look.people.result(), segmented.frame.time_s
    unknown = [target for target in targets if not isinstance(target.track, Body)]
    is_lost = any(target.may_be_anywhere for target in targets)
    # unknown people are searched for one after another
    if is_lost or any(target.is_search_due(time_s) for target in unknown[:1]):
        return replace(sight, people=people, candidates=look.candidates(segmented, interval_s))
    return replace(sight, people=people)
