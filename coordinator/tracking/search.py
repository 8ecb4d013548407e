"""A search for a body that is under way: stage by stage, between other work."""

from __future__ import annotations

from gepf.coordinator.tracking.candidate_refinement import Search
from gepf.coordinator.tracking.pose_candidates import Detection
from gepf.coordinator.tracking.refiner import Requests
from gepf.coordinator.tracking.segmenter import UntrackedPerson


class BodySearch:
    """A search for a body: running, or ended with a result that has not been taken yet.

    If a recorded frame begins a search, the same frame waits for it and takes its result
    (`TargetTracker.submit`). The search of a live frame advances while the workers refine
    (`Tracker.follow`), and at the end of a frame (`LivePacing.end_frame`).
    Its result is taken before a later frame is segmented if the body was unknown
    (`TargetTracker.accept_first_detection`), or else when a later frame is submitted.
    """

    def __init__(self, stages: Search[Detection], person: UntrackedPerson | None) -> None:
        self.person = person  # what is searched, if the body may be anywhere
        self.detection: Detection | None = None  # the result
        self._stages: Search[Detection] | None = stages  # None if the search has ended
        self._sent: Requests = ()  # the requests of the present stage

    @property
    def is_running(self) -> bool:
        """Whether the search is under way."""
        return self._stages is not None

    def advance(self, *, wait: bool = True) -> bool:
        """Take the results of a stage and send the next one.

        Returns False if the search has ended or, without `wait`, if the workers have not finished the stage.
        """
        if self._stages is None or not (wait or all(request.poll() for request in self._sent)):
            return False
        try:
            self._sent = next(self._stages)
        except StopIteration as end:
            self._stages, self.detection = None, end.value
        return True

    def finish(self) -> None:
        """Wait for the end of the search."""
        while self.advance():
            pass
