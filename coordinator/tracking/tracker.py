"""The tracker: depth frames in, estimates of one person or of several out.

Recorded or live, alone or over workers, it is the same loop: a frame is segmented, particles are predicted
and refined, hypotheses are updated, assessed and reported. While the workers refine one frame, the one before
is reported and the next one is segmented.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.scene.scope import Scope
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation
from coordinator.tracking.observing.isolation import prepare as prepare_isolation
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.people.crowd import Crowd
from coordinator.tracking.people.pipeline import follow_all
from coordinator.tracking.pipeline import follow as follow_one
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.single import SingleTracker
from coordinator.tracking.state import TrackerState


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One person in one frame: what is reported, and all that is known after it."""

    estimate: Estimate
    state: TrackerState


class Tracker:
    """Tracks one body, or up to so many people, through a sequence of frames.

    Args:
        refiner: Refines particles, in this process or on workers.
        settings: What to compute, for each person.
        bodies: The bodies that may be tracked.
        people: How many at the most; the first is the one that was found first.
        scope: Which part of the scene counts, and who is meant.
        start: Values of degrees of freedom in the first frame, metres and radians; None to detect the body.
        motion: Joint motion as encoders report it.
        states: Resume from here: one state a person, of a tracker with the same settings.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        *,
        people: int = 1,
        scope: Scope | None = None,
        start: Mapping[str, float] | None = None,
        motion: KnownMotion | None = None,
        states: Sequence[TrackerState] | None = None,
    ) -> None:
        self.people = people
        self._single: SingleTracker | None = None
        self._crowd: Crowd | None = None
        if people == 1:
            known = Known(start, states[0] if states else None, motion)
            isolation = Isolation(settings.points, scope)
            self._single = SingleTracker(refiner, settings, bodies, known, isolation)
        else:
            self._crowd = Crowd(refiner, settings, bodies, people, scope, states)

    @property
    def states(self) -> list[TrackerState]:
        """All that the next frame goes on from, one a person."""
        if self._single is not None:
            return [self._single.state]
        assert self._crowd is not None
        return [each.state for each in self._crowd.followers]

    def prepare(self) -> None:
        """Load and make what the first frames need, so that no frame waits for it."""
        prepare_isolation()
        if self._single is not None:
            self._single.prepare()

    def track(self, frame: DepthFrame) -> list[Tracked]:
        """Track the next frame, one after the other."""
        if self._single is not None:
            estimates = [self._single.track(frame)]
        else:
            assert self._crowd is not None
            estimates = self._crowd.track(frame)
        return [Tracked(*each) for each in zip(estimates, self.states, strict=True)]

    def follow(self, frames: Iterable[DepthFrame], *, look_ahead: bool = True) -> Iterator[list[Tracked]]:
        """Track frames; what is known of a frame is given out while the workers refine the next one.

        The results are those of `track`. They are given out also where the next frame fails. Without
        `look_ahead`, for live input, a frame is given out before the next one is asked for.
        """
        if not look_ahead:
            yield from map(self.track, frames)
        elif self._single is not None:
            for estimate, state in follow_one(self._single, frames):
                yield [Tracked(estimate, state)]
        else:
            assert self._crowd is not None
            for results in follow_all(self._crowd, frames):
                yield [Tracked(*each) for each in results]
