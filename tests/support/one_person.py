"""A tracker of one body, whose estimates come without the list around them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from common.body import BodyModel
from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.scene.scope import Scope
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.state import Start, TrackerState
from coordinator.tracking.tracker import Tracker


class OnePerson:
    """`Tracker` for one person."""

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        start: Mapping[str, float] | None = None,
        *,
        state: TrackerState | None = None,
        motion: KnownMotion | None = None,
        scope: Scope | None = None,
    ) -> None:
        states = None if state is None else [state]
        self._tracker = Tracker(
            refiner, settings, bodies, start=start, states=states, motion=motion, scope=scope
        )
        self.prepare = self._tracker.prepare

    @property
    def state(self) -> TrackerState:
        """All that the next frame goes on from."""
        return self._tracker.states[0]

    @property
    def start(self) -> Start:
        """The body, and where tracking began."""
        return self.state.start

    @property
    def model(self) -> BodyModel:
        """The body that is tracked."""
        return self.state.start.model

    def track(self, frame: DepthFrame) -> Estimate:
        """The estimate of the next frame."""
        return self._tracker.track(frame)[0].estimate

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[tuple[Estimate, TrackerState]]:
        """Each frame's estimate, and all that was known after it."""
        for tracked in self._tracker.follow(frames):
            yield tracked[0].estimate, tracked[0].state
