"""The filter, steps 1 to 7: properties of each step, and all steps on a problem with two modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, TRANSLATION
from gepf.common.kinematics import difference
from gepf.common.refinement import Refined
from gepf.coordinator.filters.belief import Belief, choose_reported, draw_ancestors, normalise
from gepf.coordinator.filters.exploration import choose_count, choose_kinds
from gepf.coordinator.filters.gradient_enhanced import (
    begin,
    estimate_covariances,
    keep_unseen,
    merge_by_angle,
    propose,
)
from gepf.coordinator.filters.priors import draw_noise
from gepf.coordinator.settings import ExplorationSettings, FilterSettings, preset
from tests.support.bodies import hinges, puppet
from tests.support.filtering import INTERVAL, NOTHING_SEEN, advance

seeds = st.integers(0, 2**32 - 1)
PAPER = preset("paper").filter
EXPLORING = msgspec.structs.replace(PAPER, explore=True, velocity_time_s=0.1)
D = np.deg2rad(4.0)
VALLEYS = np.array([[0.5, 0.1], [-0.5, 0.1]])  # of the toy, the first a little likelier


def toy(poses: Array) -> Refined:
    """Two hinges with two modes, left and right: each particle is refined to the nearer one."""
    right = poses[:, 0] > 0.0
    refined = np.where(right[:, None], VALLEYS[0], VALLEYS[1]) + 1e-4 * np.sin(poses)
    return Refined(refined, np.where(right, 0.0, -0.1) - 1e-3 * poses[:, 1] ** 2, np.full(len(poses), 0.01))


def follow(
    refine: Callable[[Array], Refined],
    settings: FilterSettings,
    seed: int,
    frames: int,
    *,
    merges_early: bool = False,
) -> list[Belief]:
    """The filter over some frames."""
    rng, found = np.random.default_rng(seed), [begin(hinges(), np.zeros(2), settings)]
    for _ in range(frames):
        found.append(advance("gepf", hinges(), found[-1], refine, settings, rng, merges_early=merges_early))
    return found[1:]


def some(rng: np.random.Generator, count: int) -> Array:
    """Poses (count, 19) of the puppet, in clusters."""
    model = puppet()
    spread = np.where(model.kinds == ROTATION, 0.6 * D, 1.0)
    bunches = rng.normal(size=(3, len(spread)))
    return np.asarray(bunches[rng.integers(3, size=count)] + spread * rng.normal(size=(count, len(spread))))


# Step 2: drawing


@given(st.lists(st.floats(-800.0, 50.0) | st.just(-np.inf), min_size=1, max_size=8), st.floats(-1e6, 1e6))
def test_weights_are_normalised(log_weights: list[float], shift: float) -> None:
    """Their ratios are those of the likelihoods, whatever is added to all logarithms; their sum is 1."""
    weights = normalise(np.array(log_weights))
    if np.any(np.isfinite(log_weights)):
        expected = np.exp(np.array(log_weights) - max(log_weights))
        np.testing.assert_allclose(weights, expected / expected.sum(), atol=1e-12)
        np.testing.assert_allclose(normalise(np.array(log_weights) + shift), weights, atol=1e-8)
    else:
        np.testing.assert_array_equal(weights, 1.0 / len(weights))


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8).filter(lambda w: sum(w) > 1e-3),
    st.integers(1, 40),
    seeds,
)
def test_each_is_drawn_by_its_weight_give_or_take_one(weights: list[float], count: int, seed: int) -> None:
    """Ancestors ascend; each is drawn as often as expected, rounded, and never with weight zero."""
    w = np.array(weights)
    ancestors = draw_ancestors(w, count, np.random.default_rng(seed))
    assert len(ancestors) == count
    assert np.all(np.diff(ancestors) >= 0)
    drawn = np.bincount(ancestors, minlength=len(w))
    assert np.all(np.abs(drawn - count * w / w.sum()) < 1.0 + 1e-9)
    assert np.all(drawn[w == 0.0] == 0)


def test_drawing_is_unbiased() -> None:
    """Over many seeds each is drawn in proportion to its weight."""
    weights = np.array([0.05, 0.0, 0.33, 0.11, 0.51])
    drawn = np.stack([draw_ancestors(weights, 7, np.random.default_rng(seed)) for seed in range(4000)])
    counts = np.bincount(drawn.ravel(), minlength=5) / 4000
    np.testing.assert_allclose(counts, 7.0 * weights, atol=4.0 * 0.5 / np.sqrt(4000))


# Step 3: moving


def test_noise_has_the_ancestors_covariance() -> None:
    """Many draws have the covariance of their ancestors, also if it is singular."""
    rng = np.random.default_rng(0)
    root = np.array([[0.3, 0.0, 0.0], [0.2, 0.1, 0.0], [0.0, 0.0, 0.0]])  # the third direction is flat
    covariances = np.stack([root @ root.T, np.diag([1.0, 4.0, 9.0])])
    ancestors = np.repeat([0, 1], 20_000)
    noise = draw_noise(covariances, ancestors, rng)
    for m, expected in enumerate(covariances):
        drawn = noise[ancestors == m]
        np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.05)
        np.testing.assert_allclose(np.cov(drawn.T), expected, atol=0.03 * max(1.0, expected.max()))
    np.testing.assert_allclose(noise[ancestors == 0, 2], 0.0, atol=1e-9)


@given(seeds, st.integers(20, 120), st.integers(1, 4))
def test_each_kind_of_proposal_has_its_share(seed: int, count: int, cameras: int) -> None:
    """For any number of hypotheses; the first particle is neither spread nor data-driven."""
    spread, data_driven = choose_kinds(count, np.random.default_rng(seed), ExplorationSettings(), cameras)
    assert not spread[0]
    assert not data_driven[0]
    assert not np.any(spread & data_driven)
    assert np.all(spread[1:] | data_driven[1:])
    assert 0.3 * count <= np.count_nonzero(data_driven) <= 0.5 * count


def test_a_frame_has_fewer_particles_if_the_prediction_explains_it() -> None:
    """The share of points near no part decides; all particles without points, or if many are unexplained."""
    near = np.ones((2, 1000), dtype=np.bool_)
    counts = []
    for unexplained in (0, 10, 20, 30, 200):
        near[:, :unexplained] = False
        counts.append(choose_count(20, near, ExplorationSettings()))
    assert counts == sorted(counts)
    assert 1 < counts[0] < counts[2] < counts[-1] == 20
    assert choose_count(20, np.empty((2, 0), dtype=np.bool_), ExplorationSettings()) == 20
    assert choose_count(3, near, ExplorationSettings()) == 3


@pytest.mark.parametrize("unexplained", [0, 20, 200])
def test_more_cameras_have_fewer_particles(unexplained: int) -> None:
    """Particles times cameras are as many as with one camera, and at least one particle is left."""
    near = np.ones((2, 1000), dtype=np.bool_)
    near[:, :unexplained] = False
    alone = choose_count(20, near, ExplorationSettings())
    for cameras in (2, 3, 4):
        assert alone <= cameras * choose_count(20, near, ExplorationSettings(), cameras) < alone + cameras
    assert choose_count(1, near, ExplorationSettings(), 4) == 1


def test_predicted_particles_move_on_and_others_are_spread() -> None:
    """A hypothesis at 1 rad/s is predicted with a decaying velocity, with and without noise."""
    past = replace(begin(hinges(), np.zeros(2), PAPER), velocities=np.array([[1.0, 0.0]]))
    proposal = propose(hinges(), past, NOTHING_SEEN, EXPLORING, np.random.default_rng(0))
    ahead = np.isclose(proposal.poses[:, 0], np.exp(-1.0) * INTERVAL)
    assert ahead[0]
    assert ahead.mean() <= 0.5


# Step 6: merging


@given(seeds, st.integers(1, 25))
def test_merging_keeps_the_likeliest_of_what_is_near(seed: int, count: int) -> None:
    """A group's representative is its likeliest, within d of all members; representatives are not."""
    rng = np.random.default_rng(seed)
    model, poses, log_likelihood = puppet(), some(rng, count), rng.normal(size=count)
    angles = model.kinds == ROTATION
    chosen, group = merge_by_angle(model, poses, log_likelihood, D)
    assert np.all(np.diff(log_likelihood[chosen]) < 0.0)
    assert chosen[0] == np.argmax(log_likelihood)
    assert group.shape == (count,)
    for m, representative in enumerate(chosen):
        members = np.flatnonzero(group == m)
        assert representative in members
        assert log_likelihood[representative] == log_likelihood[members].max()
        apart = difference(model, poses[members], np.tile(poses[representative], (len(members), 1)))
        assert np.all(np.abs(apart[:, angles]) < D)
    for m in range(1, len(chosen)):
        apart = difference(model, np.tile(poses[chosen[m]], (m, 1)), poses[chosen[:m]])
        assert np.all(np.abs(apart[:, angles]).max(axis=1) >= D)


@given(seeds)
def test_neither_order_nor_position_of_particles_matters(seed: int) -> None:
    """Shuffled, the root and joints that slide moved at will, they make the same hypotheses."""
    rng = np.random.default_rng(seed)
    model, poses, log_likelihood = puppet(), some(rng, 12), rng.normal(size=12)
    order = rng.permutation(12)
    chosen, group = merge_by_angle(model, poses, log_likelihood, D)
    moved = poses + np.where(model.kinds == TRANSLATION, 5.0 * rng.normal(size=poses.shape), 0.0)
    again, regrouped = merge_by_angle(model, moved[order], log_likelihood[order], D)
    np.testing.assert_array_equal(order[again], chosen)
    np.testing.assert_array_equal(regrouped, group[order])


# Merging after the first iterations


@pytest.mark.parametrize("seed", range(4))
def test_merging_early_changes_nothing_if_the_first_iterations_converge(seed: int) -> None:
    """Hypotheses, weights, velocities, and covariances of what was drawn are those of merging once."""
    asked = list[int]()

    def converge(poses: Array) -> Refined:
        asked.append(len(poses))
        right = poses[:, 0] > 0.0
        refined = np.where(right[:, None], VALLEYS[0], VALLEYS[1])
        return Refined(refined, np.where(right, 0.0, -0.1), np.full(len(poses), 0.01))

    once = follow(converge, EXPLORING, seed, frames=10)
    drawn = asked.copy()
    asked.clear()
    early = follow(converge, EXPLORING, seed, frames=10, merges_early=True)
    assert asked[::2] == drawn
    assert max(asked[1::2]) == 2 < min(drawn)
    for before, after in zip(once, early, strict=True):
        for name in ("poses", "log_weights", "residual", "velocities", "reported", "covariances"):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_particles_that_join_a_mode_late_count_for_its_covariance() -> None:
    """Two groups after the first iterations become one after all: Eq. 7 is over the particles of both."""
    drawn, calls = list[Array](), 0

    def approach(poses: Array) -> Refined:
        nonlocal calls
        calls += 1
        if calls == 1:
            drawn.append(poses.copy())
            side = np.where(poses[:, 0] > 0.0, 0.1, -0.1)
            return Refined(np.column_stack([side, 0.0 * side]), np.zeros(len(poses)), np.zeros(len(poses)))
        assert sorted(poses[:, 0]) == [-0.1, 0.1]
        return Refined(np.zeros_like(poses), np.zeros(2), np.zeros(2))

    (belief,) = follow(approach, EXPLORING, seed=1, frames=1, merges_early=True)
    (particles,) = drawn
    np.testing.assert_allclose(belief.covariances, 0.9 * (particles.T @ particles)[None] / len(particles))


@pytest.mark.parametrize(("behind", "modes"), [(3.0, 2), (20.0, 1), (np.inf, 1)])
def test_what_is_unlikely_after_the_first_iterations_is_dropped(behind: float, modes: int) -> None:
    """A mode far behind the most likely one is not refined further."""
    asked = list[int]()

    def refine(poses: Array) -> Refined:
        asked.append(len(poses))
        found = toy(poses)
        return replace(found, log_likelihood=np.where(poses[:, 0] > 0.0, 0.0, -behind))

    (belief,) = follow(refine, EXPLORING, seed=1, frames=1, merges_early=True)
    assert asked[1:] == [modes]
    assert len(belief.poses) == modes


def test_a_frame_in_which_every_particle_diverges_has_a_belief() -> None:
    """Also if this is known after the first iterations."""

    def diverge(poses: Array) -> Refined:
        return Refined(poses, np.full(len(poses), -np.inf), np.full(len(poses), np.inf))

    (belief,) = follow(diverge, EXPLORING, seed=1, frames=1, merges_early=True)
    assert len(belief.poses) > 0
    assert np.all(np.isfinite(belief.poses))


# Step 7: covariances


def test_covariance_by_hand() -> None:
    """Eq. 7: about the hypothesis after descent, of the particles before it; then 10 % less."""
    before = np.array([[1.1, 2.0], [0.9, 2.2], [7.0, 7.0]])
    merged = np.array([[1.0, 2.0], [6.0, 6.0]])
    inherited = np.array([np.eye(2), [[4.0, 1.0], [1.0, 2.0]]])
    found = estimate_covariances(hinges(), before, merged, np.array([0, 0, 1]), inherited, 0.1)
    np.testing.assert_allclose(found[0], 0.9 * np.array([[0.01, -0.01], [-0.01, 0.02]]), atol=1e-12)
    np.testing.assert_allclose(found[1], 0.9 * inherited[1], atol=1e-12)  # a lone particle inherits


# The whole


def test_it_begins_as_wide_as_the_merging_distance() -> None:
    """Step 1: one hypothesis at the given pose, 4 degrees and 2 cm wide, at rest."""
    model, pose = puppet(), np.arange(19.0)
    first = begin(model, pose, PAPER)
    np.testing.assert_array_equal(first.poses, pose[None])
    np.testing.assert_array_equal(first.velocities, np.zeros((1, 19)))
    deviations = np.sqrt(np.diagonal(first.covariances[0]))
    np.testing.assert_allclose(deviations, np.where(model.kinds == ROTATION, D, 0.02))
    assert first.weights.tolist() == [1.0]


@pytest.mark.parametrize("explores", [False, True])
def test_two_valleys_stay_two_hypotheses(explores: bool) -> None:
    """Over twenty frames both modes are tracked, the likelier one first, weighted by likelihood."""
    settings = msgspec.structs.replace(PAPER, explore=explores)
    for found in follow(toy, settings, seed=1, frames=20):
        np.testing.assert_allclose(found.poses, VALLEYS, atol=1e-3)
        assert found.weights[0] > found.weights[1] > 0.4
        assert np.all(np.diff(found.log_weights) < 0.0)


def test_every_hypothesis_goes_back_to_its_own_ancestor() -> None:
    """Velocity and inherited covariance are those of its ancestor, whichever is the likeliest."""
    past = Belief(
        poses=np.array([[0.0, 0.0], [1.0, 2.0]]),
        log_weights=np.zeros(2),
        residual=np.zeros(2),
        velocities=np.zeros((2, 2)),
        reported=np.zeros(2),
        covariances=np.array([1e-8 * np.eye(2), 4e-8 * np.eye(2)]),
    )

    def onward(poses: Array) -> Refined:
        return Refined(
            np.round(poses) + np.array([[0.1, 0.0], [0.0, 0.3]]), np.array([-1.0, 0.0]), np.zeros(2)
        )

    settings = msgspec.structs.replace(PAPER, particles=2)
    found = advance("gepf", hinges(), past, onward, settings, np.random.default_rng(0))
    np.testing.assert_allclose(found.poses, [[1.0, 2.3], [0.1, 0.0]])
    np.testing.assert_allclose(INTERVAL * found.velocities, [[0.0, 0.3], [0.1, 0.0]], atol=1e-12)
    np.testing.assert_allclose(found.covariances, 0.9 * past.covariances[::-1])


@pytest.mark.parametrize("explores", [False, True])
def test_a_single_particle_has_no_noise(explores: bool) -> None:
    """Gradient tracking is the same filter: one particle, moved by its velocity alone."""
    settings = msgspec.structs.replace(
        PAPER, particles=1, explore=explores, velocity_time_s=INTERVAL / np.log(2.0)
    )
    asked: list[Array] = []

    def moving(poses: Array) -> Refined:
        asked.append(poses.copy())
        return Refined(poses + np.array([0.1, -0.2]), np.zeros(1), np.zeros(1))

    follow(moving, settings, seed=0, frames=3)
    expected = np.array([[0.0, 0.0], [0.15, -0.3], [0.325, -0.65]])
    np.testing.assert_allclose(np.concatenate(asked), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("better_by", "interval", "reported"),
    [
        (0.0, 1 / 30, 0),  # about equally likely: where it was
        (0.5, 1 / 30, 0),
        (20.0, 1 / 30, 1),  # much likelier: there, however far
        (0.5, 1.0, 1),  # a second ago it may have been anywhere
    ],
)
def test_the_report_goes_on_where_it_was_unless_another_is_much_likelier(
    better_by: float, interval: float, reported: int
) -> None:
    """Two hypotheses, one near the last report, one with an arm elsewhere."""
    model = puppet()
    last = np.zeros(len(model.dof_names))
    turning = int(np.flatnonzero(model.kinds == ROTATION)[0])
    poses = np.stack([last, last])
    poses[0, turning], poses[1, turning] = 0.02, 1.2
    chosen = choose_reported(model, last, poses, np.array([0.0, better_by]), interval, 1.8)
    assert np.array_equal(chosen, poses[reported])


@given(st.integers(0, 2**32 - 1))
def test_covariances_stay_valid_while_limbs_are_out_of_view(seed: int) -> None:
    """Those of limbs that got no noise are kept, and the whole stays positive semidefinite."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(2, 3, 6, 6)) * np.exp(3.0 * rng.normal(size=(2, 3, 6, 1)))
    now, before = roots @ roots.transpose(0, 1, 3, 2)
    unseen = rng.random(6) < 0.5
    kept = keep_unseen(now, before, unseen)
    both = unseen[:, None] & unseen
    np.testing.assert_array_equal(kept[:, both], before[:, both])
    values = np.linalg.eigvalsh(kept)
    assert np.all(values >= -1e-9 * np.abs(values).max(axis=1, keepdims=True))
