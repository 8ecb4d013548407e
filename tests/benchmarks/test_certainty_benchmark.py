"""The fit of the tracker's certainty recovers the law of synthetic data, and the scores show it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.certainty.fitting import distances, fit
from benchmarks.certainty.gather import Gathered
from benchmarks.certainty.scores import score
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.tracking.certainty import Features, judge

FRAMES, JOINTS = 4_000, 6
STEEPNESS = 1.5


def drawn(seed: int, person: str = "", shift: float = 0.0, size: float = 0.05, kind: str = "") -> Gathered:
    """Joints with errors that grow as less of them is visible; all other features carry no information."""
    rng = np.random.default_rng(seed)
    features = Features(*rng.uniform(size=(len(Features._fields), FRAMES, JOINTS)))
    direction = rng.normal(size=(FRAMES, JOINTS, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    deviation = size * np.exp(STEEPNESS * (1.0 - features.seen))
    apart = direction * np.abs(rng.normal(size=(FRAMES, JOINTS)) * deviation)[..., None]
    apart[..., 0] += shift
    holds = np.ones((FRAMES, JOINTS), dtype=bool)
    return Gathered(kind or person, person, features, apart, holds, np.full(FRAMES, "tracked"))


def test_the_fit_holds_on_data_that_it_has_not_seen() -> None:
    """68 and 95 % of joints, visible or hidden, are within one and two deviations."""
    found, fresh = fit([drawn(0, "s1")], ["s1"]), drawn(1, "s2")
    scored = score("fresh", [fresh], found)
    for side in (scored.seen, scored.hidden):
        assert side.within_one == pytest.approx(68.0, abs=4.0)
        assert side.within_two == pytest.approx(95.0, abs=3.0)
    chance = judge(fresh.features, CertaintySettings(fit=found)).off_probability
    off = distances([fresh])[0] > 0.15
    assert chance.mean() == pytest.approx(off.mean(), abs=0.02)
    shares = [off[(chance > low) & (chance < low + 0.1)].mean() for low in (0.0, 0.1, 0.2, 0.3)]
    assert shares == sorted(shares)
    assert dict(scored.roc)[5.0] > 15.0


def test_people_and_other_recordings_count_alike_however_many_there_are() -> None:
    """Ten times as many accurate joints of other kinds have the same effect as an equal number."""
    person = drawn(9, "s1")
    sound = [drawn(10 + k, size=0.025, kind="rendered") for k in range(10)]
    rates = [np.mean(np.concatenate(distances(some)) > 0.15) for some in ([person], sound)]
    for others in (sound, sound[:1]):
        found = fit([person, *others], ["s1"])
        chances = judge(person.features, CertaintySettings(fit=found)).off_probability.mean()
        assert chances == pytest.approx(np.mean(rates), rel=0.1)


def test_a_persons_constant_offset_counts_for_nothing_and_an_exact_truth_has_none() -> None:
    """A vendor's joints have constant offsets; those of rendered people do not."""
    plain, of_a_person, exact = drawn(3), drawn(3, "s1", 0.3), drawn(3, "", 0.3)
    assert distances([of_a_person])[0].mean() == pytest.approx(distances([plain])[0].mean(), abs=0.002)
    assert distances([exact])[0].mean() > 0.25


def test_joints_that_do_not_hold_count_for_nothing() -> None:
    """A reference that depth contradicts changes neither fit nor score."""
    good, bad = drawn(4, "s1"), drawn(5, "s1")
    bad.apart[:], bad.holds[:] = 3.0, False
    one, both = fit([good], ["s1"]), fit([good, bad], ["s1"])
    assert one.weights == pytest.approx(both.weights)
    assert score("both", [good, bad], both).joints == score("one", [good], one).joints
