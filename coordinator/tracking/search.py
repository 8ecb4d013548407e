"""A search for a body that is under way: stage by stage, between other work."""

from __future__ import annotations

from gepf.coordinator.tracking.candidate_refinement import Search
from gepf.coordinator.tracking.pose_candidates import Detection
from gepf.coordinator.tracking.refiner import Requests
from gepf.coordinator.tracking.segmenter import UntrackedPerson


class BodySearch:
    """At most one search for a body: running, or ended with a result that is not yet taken.

    If a recorded frame begins a search, the same frame waits for it and takes its result
    (`TargetTracker.submit`). The search of a live frame advances while the workers refine
    (`Tracker.follow`), and at the end of a frame (`Live.end_frame`).
    Its result is taken before a later frame is segmented if the body was unknown
    (`TargetTracker.take_search`), or else when a later frame is submitted.
    """

    def __init__(self) -> None:
        self.person: UntrackedPerson | None = None  # what is searched, if the body may be anywhere
        self._stages: Search[Detection] | None = None  # None if no search is running
        self._sent: Requests = ()  # the requests of the present stage
        self._detection: Detection | None = None

    def begin(self, stages: Search[Detection], person: UntrackedPerson | None) -> None:
        """Begin another search; `person` is what is searched, if the body may be anywhere."""
        self.person, self._stages, self._sent, self._detection = person, stages, (), None

    @property
    def is_running(self) -> bool:
        """Whether a search is under way."""
        return self._stages is not None

    def advance(self, *, wait: bool = True) -> bool:
        """Take the results of a stage and send the next one.

        Returns False if no search is running or, without `wait`, if the workers have not finished the stage.
        """
        if self._stages is None or not (wait or all(request.poll() for request in self._sent)):
            return False
        try:
            self._sent = next(self._stages)
        except StopIteration as end:
            self._stages, self._detection = None, end.value
        return True

    def finish(self) -> None:
        """Wait for the end of the search, if there is one."""
        while self.advance():
            pass

    def take(self) -> Detection | None:
        """What was detected; None if no search has ended."""
        detection = self._detection
        if detection is not None:
            self.drop()
        return detection

    def drop(self) -> None:
        """Give up the search, if there is one."""
        self.person = self._stages = self._detection = None
        self._sent = ()
