"""What is counted over a run has the same size for a minute as for a week."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from gepf.coordinator.results.tally import Tally
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.reporting import explain_doubt
from tests.support.recorded import estimate

JOINTS = tuple("ABCDEFGH")


def test_reasons_do_not_grow_with_the_run() -> None:
    """Doubtful joints come in thousands of orders and combinations; each of them is counted by itself."""
    rng, tally, doubted = np.random.default_rng(0), Tally(), Counter[str]()
    for number in range(2000):
        certainty = replace(unknown_certainty(len(JOINTS)), off_probability=rng.random(len(JOINTS)))
        doubted.update(name for name, p in zip(JOINTS, certainty.off_probability, strict=True) if p > 0.5)
        why = explain_doubt(JOINTS, certainty, certainty.off_probability > 0.5, 0.15)
        tally.add(replace(estimate(number, status="ambiguous"), why=why))
    assert {reason[-1]: count for reason, count in tally.doubts.items() if count > 100} == doubted
    assert len(tally.doubts) <= len(JOINTS) + 1  # no joint is in doubt in a few frames


def test_a_reason_without_a_list_is_counted_as_it_is() -> None:
    """Also with a colon, with names before it, or with a comma."""
    reasons = [
        "nobody",
        "front and back look alike: the body may face the other way",
        "a, b disagree with c: one of them",
        "two planes fit the observed points better than a body: an object, not a person",
        "the body is upside down; if the camera is, use --rotate",
    ]
    tally = Tally.of(replace(estimate(0, status="lost"), why=why) for why in reasons)
    assert tally.doubts == Counter(reasons)
