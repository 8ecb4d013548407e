"""One tracker: depth frames in, estimates out.

A frame's way: `submit` cuts the body out, draws particles and sends them to the workers; `collect` waits for
them and updates the belief; `report` gives the estimate. `track` does all three.
"""

from __future__ import annotations

from common.frame import DepthFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.follower import Follower
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation
from coordinator.tracking.observing.lookout import CutOut, Lookout
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.search.verdict import FEWEST
from coordinator.tracking.step import Submitted


class SingleTracker(Follower):
    """Cuts one body out of the frames of a sequence, and follows it.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute. What makes their method holds whatever else they say.
        bodies: Gives the body that is tracked, by its measures.
        known: What is known of it beside the frames; None for nothing.
        isolation: Cuts the body out of the frames; None for the usual way.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        known: Known | None = None,
        isolation: Isolation | None = None,
    ) -> None:
        super().__init__(refiner, settings, bodies, known)
        self._fewest = min(FEWEST, settings.points)
        self._lookout = Lookout(isolation or Isolation(settings.points))
        if known is not None and known.state is not None:
            self._lookout.recall(self._scene)

    def track(self, frame: DepthFrame) -> Estimate:
        """Follow the body into the next frame, or look for it."""
        return self.report(self.collect(self.submit(frame))).estimate

    def submit(self, frame: DepthFrame) -> Submitted:
        """Draw particles for the next frame and let the workers refine them; `collect` has to follow."""
        return self.submit_cut(self._look_about(self._lookout.cut(frame, self.near)))

    def send_ahead(self, frame: DepthFrame | None) -> None:
        """Cut out the frame that comes next, and let the workers have it before its turn."""
        if frame is not None:
            self.send_cut_ahead(self._lookout.cut_ahead(frame, self.near))

    def _look_about(self, cut: CutOut) -> CutOut:
        """The frame with whoever is seen elsewhere, if next to nothing is where the body was."""
        if not self.misses(cut):
            return cut
        elsewhere = self._lookout.find_anybody(cut, self.last_seen, self._fewest)
        if elsewhere is not cut:
            self.saw_nobody()
        return elsewhere
