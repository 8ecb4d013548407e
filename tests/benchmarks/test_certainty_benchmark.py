"""The fit of the tracker's certainty: it finds the law that data were drawn from, and scores show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.certainty.__main__ import main
from benchmarks.certainty.cutting import cut_below, row_between
from benchmarks.certainty.fitting import averaged, distances, fit, fit_functions, fit_logistic, halfway, judge
from benchmarks.certainty.gather import Gathered
from benchmarks.certainty.scores import score
from common.camera import Intrinsics
from common.frame import DepthFrame
from coordinator.tracking.certainty.evidence import CLUES

FRAMES, JOINTS = 4_000, 6
STEEPNESS = 1.5


def drawn(seed: int, person: str = "", shift: float = 0.0) -> Gathered:
    """Joints whose distance grows with the first clue, each frame by itself; the other clues say nothing."""
    rng = np.random.default_rng(seed)
    evidence = rng.uniform(-1.0, 1.0, size=(FRAMES, JOINTS, len(CLUES)))
    deviation = 0.05 * np.exp(STEEPNESS * evidence[..., 0])
    direction = rng.normal(size=(FRAMES, JOINTS, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    apart = direction * np.abs(rng.normal(size=(FRAMES, JOINTS)) * deviation)[..., None]
    apart[..., 0] += shift
    holds = np.ones((FRAMES, JOINTS), dtype=bool)
    return Gathered(
        person, "drawn", 1, False, np.full(FRAMES, 10.0), evidence, apart, holds, np.full(FRAMES, "tracked")
    )


def nearer(one: Gathered, share: float) -> Gathered:
    """The same with all joints at so much of their distance."""
    return replace(one, apart=share * one.apart)


def test_the_fit_holds_on_data_that_it_has_not_seen() -> None:
    """68 and 95 % of joints within one and two deviations, seen and hidden; chances rise with the shares."""
    functions = fit([drawn(0)])
    fresh = drawn(1)
    found = score("fresh", [fresh], functions)
    for side in (found.seen, found.hidden):
        assert side.within_one == pytest.approx(68.0, abs=4.0)
        assert side.within_two == pytest.approx(95.0, abs=3.0)
    chance = 1.0 / (1.0 + np.exp(-judge(fresh, functions)[..., 0]))
    off = distances([fresh])[0] > 0.15
    assert chance.mean() == pytest.approx(off.mean(), abs=0.02)
    shares = [off[(chance > low) & (chance < low + 0.1)].mean() for low in (0.0, 0.1, 0.2, 0.3)]
    assert shares == sorted(shares)
    assert dict(found.roc)[5.0] > 30.0


def test_hidden_joints_of_people_who_were_not_fitted_are_said_to_be_farther_off() -> None:
    """Of two people who differ, each judged by the fit to the other, 68 % of hidden joints are within one."""
    near, far = drawn(6, "s1"), drawn(7, "s2")
    far.apart[far.evidence[..., 0] < 0.5] *= 2.0
    found = fit([near, far]).unseen
    assert found > 0.0
    assert fit([near]).unseen == 0.0
    within = []
    for one, other in ((near, far), (far, near)):
        judged = judge(one, replace(fit_functions([other]), unseen=found))[..., 1]
        within.append((distances([one])[0] < np.exp(judged))[one.evidence[..., 0] < 0.5])
    assert np.mean(within[0].tolist() + within[1].tolist()) == pytest.approx(0.683, abs=0.01)


def test_a_fit_from_far_off_comes_to_rest() -> None:
    """Where joints are hardly ever off and much is given, whole Newton steps would run away."""
    rng = np.random.default_rng(8)
    evidence, given = rng.normal(size=(20_000, 3)), rng.normal(-2.0, 6.0, size=20_000)
    chance = 1.0 / (1.0 + np.exp(-(evidence @ (3.0, -2.0, 0.0) + given - 5.0)))
    off = rng.random(20_000) < chance
    columns = np.column_stack([np.ones(len(off)), np.zeros(len(off)), evidence])
    found = fit_logistic(columns, off, given, np.ones(len(off)))
    fitted = 1.0 / (1.0 + np.exp(-(columns @ found + given)))
    assert fitted.mean() == pytest.approx(off.mean(), rel=1e-6)
    assert found[2] > 1.0
    assert found[3] < -0.5


def test_rendered_people_do_not_set_the_rate_at_which_joints_of_people_are_off() -> None:
    """Beside ten times as many rendered ones that are hardly ever off, chances of people stay as they are."""
    person, sound = drawn(9, "s1"), [nearer(drawn(10 + k), 0.5) for k in range(10)]
    alone, beside = fit([person]), fit([person, *sound])
    off = distances([person])[0] > 0.15
    for functions in (alone, beside):
        chance = 1.0 / (1.0 + np.exp(-judge(person, functions)[..., 0]))
        assert chance.mean() == pytest.approx(off.mean(), rel=0.05)


def test_half_way_to_a_fit_lies_the_mean_of_the_odds_and_the_deviation_of_before() -> None:
    """Of evidence within the limits of both, joint for joint."""
    near, far = drawn(11, "s1"), drawn(12, "s2")
    far.apart[:] *= 3.0
    before, now = fit([near]), replace(fit([far]), unseen=0.4)
    within = replace(near, evidence=0.9 * near.evidence)
    (odds, deviation), (others, other_deviation) = (
        np.moveaxis(judge(within, one), -1, 0) for one in (before, now)
    )
    found = judge(within, halfway(before, now))
    np.testing.assert_allclose(found[..., 0], 0.5 * (odds + others))
    np.testing.assert_allclose(found[..., 1], deviation)
    assert not np.allclose(odds, others, atol=0.1)
    assert not np.allclose(deviation, other_deviation, atol=0.1)


def test_a_persons_constant_offset_counts_for_nothing_and_an_exact_truth_has_none() -> None:
    """The vendor's joints lie elsewhere in the body; rendered people's do not."""
    plain, of_a_person, exact = drawn(3), drawn(3, "s1", 0.3), drawn(3, "", 0.3)
    assert distances([of_a_person])[0].mean() == pytest.approx(distances([plain])[0].mean(), abs=0.002)
    assert distances([exact])[0].mean() > 0.25


def test_joints_that_do_not_hold_count_for_nothing() -> None:
    """A reference that the depth contradicts changes neither fit nor score."""
    good, bad = drawn(4), drawn(5)
    bad.apart[:], bad.holds[:] = 3.0, False
    one, both = fit([good]), fit([good, bad])
    np.testing.assert_allclose(one.probability[1], both.probability[1])
    assert score("both", [good, bad], both).joints == score("one", [good], one).joints


def test_evidence_is_averaged_as_the_tracker_does() -> None:
    """A clue beyond its limits counts as the limit, and the frames before fade with time."""
    one = drawn(6)
    one.interval[:] = 0.116
    low, high = np.full(len(CLUES), -0.5), np.full(len(CLUES), 0.5)
    means = averaged(one, low, high)
    within = np.clip(one.evidence, low, high)
    np.testing.assert_allclose(means[1], np.exp(-1.0) * within[0] + (1.0 - np.exp(-1.0)) * within[1])


def test_a_picture_ends_between_knees_and_hips() -> None:
    """At the row of the joints' mean place, frames without any aside; what is above stays as it was."""
    names = ("left_hip", "right_hip", "left_knee", "right_knee")
    camera = Intrinsics(320, 240, 300.0, 300.0, 160.0, 120.0)
    standing = np.array([[-0.1, 0.0, 3.0], [0.1, 0.0, 3.0], [-0.1, 0.4, 3.0], [0.1, 0.4, 3.0]])
    joints = np.stack([standing, np.full_like(standing, np.nan)])
    assert row_between(joints, names, 0.0, camera) == 160
    assert row_between(joints, names, 0.5, camera) == 140
    depth = np.random.default_rng(0).integers(0, 4000, (240, 320), dtype=np.uint16)
    cut = cut_below(DepthFrame(3, 0.1, depth, 1000.0, camera), 140)
    assert np.array_equal(cut.depth, depth[:140])
    assert (cut.intrinsics.height, cut.intrinsics.cy, cut.number) == (140, 120.0, 3)


def test_nothing_is_fitted_beside_the_demo(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line that names the option."""
    assert main(["--fit", "--demo", "2"]) == 2
    assert "--demo" in capsys.readouterr().err
