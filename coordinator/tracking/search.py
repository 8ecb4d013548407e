"""A search for a body that is under way: stage by stage, between other work."""

from __future__ import annotations

from gepf.common.frame import SubjectFrame
from gepf.coordinator.tracking.candidate_refinement import Search
from gepf.coordinator.tracking.pose_candidates import Detection
from gepf.coordinator.tracking.refiner import Requests


class BodySearch:
    """At most one search for a body: running, or ended with a result that is not yet taken."""

    def __init__(self) -> None:
        self.subject: SubjectFrame | None = None  # in which the body is searched for
        self._search: Search[Detection] | None = None  # None also when done
        self._sent: Requests = ()  # to the workers
        self._found: Detection | None = None

    def begin(self, search: Search[Detection], subject: SubjectFrame) -> None:
        """Begin another search."""
        self.subject, self._search, self._sent, self._found = subject, search, (), None

    @property
    def runs(self) -> bool:
        """Whether a search is under way."""
        return self._search is not None

    def advance(self, *, wait: bool = True) -> bool:
        """Take the results of a stage and send the next one; False if there is none.

        Without `wait`, also if the workers are not ready with it.
        """
        if self._search is None or not (wait or all(each.is_ready for each in self._sent)):
            return False
        try:
            self._sent = next(self._search)
        except StopIteration as end:
            self._search, self._found = None, end.value
        return True

    def take(self) -> Detection | None:
        """What was detected; None if no search has ended."""
        if (found := self._found) is not None:
            self.end()
        return found

    def end(self) -> None:
        """Give up the search, if there is one."""
        self.subject = self._search = self._found = None
        self._sent = ()
