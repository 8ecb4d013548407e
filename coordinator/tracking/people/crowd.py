"""Several people tracked at once: a follower for each, over the same frames and workers.

The first person is who was found first, and so on. Who is not found yet, or lost, is looked for among whoever
is seen and not explained by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.scene.scene import NOTHING
from coordinator.scene.scope import Scope
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.follower import Follower
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolated
from coordinator.tracking.observing.lookout import CutOut
from coordinator.tracking.people.division import Divided, Division, Offer
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Reported
from coordinator.tracking.state import TrackerState
from coordinator.tracking.step import Submitted, Tracked
from coordinator.tracking.stopwatch import Stopwatch

Array = NDArray[np.float64]

CHANGED = 0.2  # share of the pixels by which who was searched in vain must have changed to be searched again
SPACED = 10  # frames after which it is anyway


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A frame divided among the people, and whoever is left in it."""

    frame: DepthFrame
    divided: Divided
    clocks: list[Stopwatch]  # one a person
    subjects: list[SubjectFrame | None]  # one a person
    offers: list[Offer]  # who may be one of those that are not found yet

    def give(self, place: int, offer: Offer) -> None:
        """Take somebody for one of the people."""
        self.subjects[place] = offer.subject
        self.offers.remove(offer)

    def cut(self, place: int) -> CutOut:
        """What one person's follower needs of the frame; what was learned of the room has the first one."""
        change = replace(self.divided.change, learned=NOTHING) if place else self.divided.change
        isolated = Isolated(self.subjects[place], self.divided.view, change)
        return CutOut(self.frame, isolated, self.clocks[place])


class Crowd:
    """Follows up to so many people through a sequence.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute, for each of them.
        bodies: Gives the bodies that are tracked, by their measures.
        people: How many at the most.
        scope: What of the scene counts, and who is meant first.
        states: Go on from here, where another crowd of the same settings left off; one a person.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        people: int,
        scope: Scope | None = None,
        states: Sequence[TrackerState] | None = None,
    ) -> None:
        self._division = Division(settings.points, scope)
        if states:
            self._division.recall(states[0].checkpoint.scene)
        past: Sequence[TrackerState | None] = states or [None] * people
        self.followers = tuple(
            Follower(refiner, settings, bodies, Known(state=state), choosy=True) for state in past
        )

    def track(self, frame: DepthFrame) -> list[Estimate]:
        """Follow all into the next frame, or look for them."""
        sight = self.see(frame)
        tracked = [self.collect(place, self.submit(place, sight)) for place in range(self.people)]
        return [each.estimate for each in self.report(tracked)]

    @property
    def people(self) -> int:
        """How many are tracked at the most."""
        return len(self.followers)

    def see(self, frame: DepthFrame) -> Sight:
        """What the next frame shows of whom; who is lost may be whoever is nearest to where that was."""
        clocks = [Stopwatch() for _ in self.followers]
        with clocks[0].stage("isolate"):
            reach = [each.watch.reach for each in self.followers]
            divided = self._division.divide(frame, [each.expected for each in self.followers], reach)
        sight = Sight(frame, divided, clocks, list(divided.subjects), list(divided.offers))
        for place, follower in enumerate(self.followers):
            if follower.start.found and follower.expected is None and sight.offers:
                sight.give(place, nearest(sight.offers, follower.last_seen))
        return sight

    def submit(self, place: int, sight: Sight) -> Submitted:
        """Let the workers refine one person's particles; `collect` has to follow before the next one's."""
        follower = self.followers[place]
        offer = self._whom_to_try(place, sight)
        if offer is not None:
            sight.give(place, offer)
            follower.hurry()
        return follower.submit_cut(sight.cut(place))

    def send_ahead(self, place: int, sight: Sight) -> None:
        """Let the workers have the next person's part of a frame before its turn."""
        if place < self.people:
            self.followers[place].send_cut_ahead(sight.cut(place))

    def collect(self, place: int, submitted: Submitted) -> Tracked:
        """Wait for one person's refined particles."""
        return self.followers[place].collect(submitted)

    def report(self, tracked: Sequence[Tracked]) -> list[Reported]:
        """What was found in a frame of which all were collected; before the next one is."""
        return [follower.report(each) for follower, each in zip(self.followers, tracked, strict=True)]

    def _whom_to_try(self, place: int, sight: Sight) -> Offer | None:
        """Who may be this person, if it is its turn to be found: all before it are."""
        if self.followers[place].start.found or not all(each.start.found for each in self.followers[:place]):
            return None
        if not sight.offers:
            return None
        watch = self.followers[place].watch
        offer = sight.offers[watch.failures % len(sight.offers)]
        changed = abs(offer.subject.pixels - watch.tried) > CHANGED * watch.tried
        untried = watch.failures < len(sight.offers)
        return offer if untried or changed or sight.frame.number % SPACED == 0 else None


def nearest(offers: Sequence[Offer], place: Array) -> Offer:
    """The one that is nearest to a place (3,)."""
    return min(offers, key=lambda offer: float(np.linalg.norm(offer.middle - place)))
