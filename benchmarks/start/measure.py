"""What becomes of a start: frame by frame what the tracker says, and how far off it is."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.start.cases import Case
from common.settings import preset
from coordinator.bodies.tracked import Bodies
from coordinator.results.evaluation import positions
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

SAYS_SO = "tracked"


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A case after it was tracked."""

    name: str
    status: Sequence[str]  # by frame
    right: Sequence[bool | None]  # by frame; None where nobody knows
    seconds: float  # of processor time, of the frame that took longest
    why: str  # what the last frame says against itself
    error_cm: float  # mean of the joints in the last frame; NaN where nobody knows

    @property
    def ends_right(self) -> bool:
        """Whether the last frame is."""
        return self.right[-1] is True

    @property
    def deceives(self) -> int:
        """Frames that are wrong and are called tracked."""
        return sum(s == SAYS_SO and r is False for s, r in zip(self.status, self.right, strict=True))


def play(case: Case, bodies: Bodies) -> Outcome:
    """Track a case from its first frame on."""
    tracker = Tracker(DirectRefiner(), preset("default"), bodies)
    tracker.prepare()
    status, right, seconds, error, why = [], [], [], np.nan, ""
    for frame in case.frames:
        began = time.process_time()
        estimate = tracker.track(frame)
        seconds.append(time.process_time() - began)
        error = distance(case, tracker.model.joint_names, estimate)
        right.append(judge(case, estimate, error))
        status.append(estimate.status)
        why = estimate.why
    return Outcome(case.name, status, right, max(seconds), why, 100.0 * error)


def distance(case: Case, names: tuple[str, ...], estimate: Estimate) -> float:
    """Mean distance of the joints from where they are, metres; NaN where that is not known."""
    truth = case.joints.get(estimate.frame)
    if truth is None:
        return float("nan")
    mine: NDArray[np.float64] = estimate.joint_positions[positions(names, case.names)]
    return float(np.linalg.norm(mine - truth, axis=-1).mean())


def judge(case: Case, estimate: Estimate, error: float) -> bool | None:
    """Whether an estimate is right; of what is no person, no estimate is."""
    if not case.joints:
        return False
    return None if estimate.frame not in case.joints else error < case.near


def count(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """Frames by status."""
    return dict(Counter(status for outcome in outcomes for status in outcome.status))
