"""When a body that is tracked is looked for elsewhere, and what counts as found anew."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from common.settings import RefineSettings
from common.sizes import Body
from coordinator.tracking.known import Known
from coordinator.tracking.search.recall import TURNS
from coordinator.tracking.search.search import QUICK, WAYS_UP
from coordinator.tracking.search.seeker import ELSEWHERE, Finding, Seeker
from coordinator.tracking.search.verdict import Verdict
from coordinator.tracking.search.watch import AGAIN, CHECKS, DOUBTFUL, EVERY, Watch
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.state import TrackerState
from gepf.direct import DirectRefiner
from tests.support.people import SETTINGS, STANDING, known, shown

Array = NDArray[np.float64]

LIKELIER = 5.0  # log likelihood


def searched(watch: Watch, strain: float, frames: int) -> list[int]:
    """The numbers of the frames that are searched, of so many explained with this strain."""
    numbers = []
    for number in range(frames):
        if watch.checks:
            numbers.append(number)
        watch = watch.followed(Verdict(strain), anew=False)
    return numbers


def test_who_was_found_is_held_against_a_search_soon_and_then_while_in_doubt() -> None:
    """Not in the very next frame, and none in a row; where front and back are alike, more often."""
    last = CHECKS[-1]
    assert searched(Watch(), 0.5, 40) == list(CHECKS)
    assert searched(Watch(strain=0.9), 0.9, 40) == [*CHECKS, *range(last + EVERY, 40, EVERY)]
    alike = searched(Watch(alike=True), 0.5, 12)
    assert alike == sorted({*CHECKS, *range(0, 12, AGAIN)})
    assert DOUBTFUL < 0.9


@pytest.mark.parametrize(
    ("moved", "lost", "anew"), [(0.0, False, False), (1.0, False, True), (0.0, True, True)]
)
def test_the_same_posture_refined_is_not_found_anew(
    monkeypatch: pytest.MonkeyPatch, moved: float, lost: bool, anew: bool
) -> None:
    """Its pose is taken, and the count of frames goes on; elsewhere, or of who was lost, it begins again."""
    find_again = Seeker.find_again

    def likelier(seeker: Seeker, *given: Any, **also: Any) -> Finding:
        found = find_again(seeker, *given, **also)
        standing = found.standing
        shifted = replace(
            standing, log_likelihood=standing.log_likelihood + LIKELIER, joints=standing.joints + moved
        )
        return replace(found, standing=shifted)

    monkeypatch.setattr(Seeker, "find_again", likelier)
    frames, before = shown("standing").frames, CHECKS[0]
    first = Tracker(DirectRefiner(), SETTINGS, known(), Known(STANDING))
    first.track(frames[0])
    checkpoint = replace(first.state.checkpoint, watch=Watch(tracked=before, seeks=lost))
    begun = TrackerState(first.state.start, checkpoint)
    tracker = Tracker(DirectRefiner(), SETTINGS, known(), Known(STANDING, begun))
    estimate = tracker.track(frames[1])
    assert estimate.status == "tracked"
    assert tracker.watch.tracked == (0 if anew else before + 1)
    assert ELSEWHERE < 1.0


@pytest.mark.parametrize(
    ("lost", "leaning", "turned"), [(False, 0.0, False), (True, 0.0, True), (False, 0.5 * np.pi, True)]
)
def test_who_stands_upright_and_is_not_lost_is_not_looked_for_lying(
    monkeypatch: pytest.MonkeyPatch, lost: bool, leaning: float, turned: bool
) -> None:
    """A search that checks a pose leaves out ways up that cannot be; who is lost, or lies, may be any way."""
    refiner, asked = DirectRefiner(), list[int]()
    submit = refiner.submit

    def count(body: Body, poses: Array, settings: RefineSettings, **also: bool) -> Any:
        asked.append(len(poses))
        return submit(body, poses, settings, **also)

    monkeypatch.setattr(refiner, "submit", count)
    tracker = Tracker(refiner, SETTINGS, known(), Known(STANDING))
    submitted = tracker.submit(shown("standing").frames[0])
    assert submitted.request is not None
    last = submitted.request.sighted.past.copy()
    last[tracker.model.dof("root_rz")] += leaning
    asked.clear()
    Seeker(known(), refiner, SETTINGS).find_again(
        submitted.request.sighted.subject, tracker.start, tracker.rules, last, lost=lost
    )
    assert asked[0] == QUICK.candidates + TURNS + turned * QUICK.turned * (len(WAYS_UP) - 1)
