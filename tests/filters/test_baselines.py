"""The baselines: properties of their steps, tracking with a perfect likelihood, and of a rendered arm."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.common.kinematics import retract
from gepf.common.refinement import Refined
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import pose_by_name
from gepf.coordinator.filters.baselines import Annealed, Condensation, find_power, survival
from gepf.coordinator.filters.belief import mean_pose
from gepf.coordinator.filters.methods import METHODS, Method, baseline, settings_for
from gepf.coordinator.settings import CertaintySettings, FilterSettings
from gepf.coordinator.synthesis.scenes import ARM_DOFS, arm
from gepf.refiners import DirectRefiner
from tests.support.bodies import hinges, puppet
from tests.support.filtering import INTERVAL, advance
from tests.support.people import OnePerson, rendered

SETTINGS = FilterSettings(particles=300)
BASELINES = ("condensation", "annealed")
seeds = st.integers(0, 2**32 - 1)


def peak(centre: Array, deviation: float) -> Callable[[Array], Refined]:
    """A Gaussian likelihood of two hinges about a pose (2,)."""

    def assess(poses: Array) -> Refined:
        apart = np.linalg.norm(poses - centre, axis=1)
        return Refined(poses, -0.5 * (apart / deviation) ** 2, apart)

    return assess


# The annealing schedule


@given(
    st.lists(st.floats(-1e4, 1e4), min_size=4, max_size=50, unique=True).filter(
        lambda v: max(v) - sorted(v)[-2] > 1e-3
    ),
    st.floats(0.3, 0.95),
)
def test_the_survival_rate_is_reached(log_likelihood: list[float], rate: float) -> None:
    """With the annealing power, the given share of particles survives, for any likelihoods."""
    values = np.array(log_likelihood)
    assert survival(values, find_power(values, rate)) == pytest.approx(rate, abs=1e-3)


def test_layers_diffuse_less_and_less() -> None:
    """From layer to layer the noise shrinks by the survival rate; each asks for as many evaluations."""
    asked: list[Array] = []

    def flat(poses: Array) -> Refined:
        asked.append(poses.copy())
        return Refined(np.zeros_like(poses), np.zeros(len(poses)), np.zeros(len(poses)))

    settings = msgspec.structs.replace(SETTINGS, particles=4000)
    method = baseline(Annealed(layers=4, survival_rate=0.25), 4000)
    begun = method.begin(hinges(), np.zeros(2), settings)
    advance(method, hinges(), begun, flat, settings, np.random.default_rng(0))
    assert [len(poses) for poses in asked] == [4000] * 4
    spread = np.array([poses.std() for poses in asked])
    np.testing.assert_allclose(spread, np.deg2rad(2.0) * 0.5 ** np.arange(4), rtol=0.05)


# Both


@pytest.mark.parametrize("method", BASELINES)
def test_a_moving_peak_is_followed(method: str) -> None:
    """At a steady 3 degrees a frame, with noise of 2, a sharp likelihood is followed without lagging."""
    path = np.deg2rad(3.0) * np.arange(30)[:, None] * np.array([1.0, -1.0])
    rng, found = np.random.default_rng(0), [METHODS[method].begin(hinges(), path[0], SETTINGS)]
    for centre in path:
        found.append(advance(method, hinges(), found[-1], peak(centre, np.deg2rad(1.0)), SETTINGS, rng))
    errors = np.rad2deg([np.abs(belief.reported - p) for belief, p in zip(found[1:], path, strict=True)])
    assert errors[5:].mean() < 0.5


def test_annealing_needs_fewer_evaluations() -> None:
    """A narrow peak 10 degrees away: 40 particles in 8 layers come nearer than 320 in one."""
    start, centre = np.zeros(2), np.deg2rad([10.0, -10.0])
    wide = Condensation(diffusion_deg=8.0)

    def error(method: Method, particles: int, seed: int) -> float:
        chosen = msgspec.structs.replace(SETTINGS, particles=particles)
        first = method.begin(hinges(), start, chosen)
        rng = np.random.default_rng(seed)
        found = advance(method, hinges(), first, peak(centre, np.deg2rad(0.2)), chosen, rng)
        return float(np.abs(found.reported - centre).mean())

    at_once = np.median([error(baseline(wide, 320), 320, seed) for seed in range(20)])
    layered = np.median([error(baseline(Annealed(wide, layers=8), 40), 40, seed) for seed in range(20)])
    assert layered < 0.5 * at_once


@pytest.mark.parametrize("method", BASELINES)
def test_particles_come_likeliest_first_with_their_velocity(method: str) -> None:
    """Weights fall, each particle knows the motion that led to it, and a frame is judged by the likeliest."""
    refine, rng = peak(np.array([0.05, 0.0]), 0.02), np.random.default_rng(0)
    first = METHODS[method].begin(hinges(), np.zeros(2), SETTINGS)
    found = advance(method, hinges(), first, refine, SETTINGS, rng)
    assert np.all(np.diff(found.weights) <= 0.0)
    assert found.poses[0, 0] > 0.02
    np.testing.assert_allclose(INTERVAL * found.velocities, found.poses, atol=1e-12)
    assert found.log_weights[0] == pytest.approx(refine(found.poses[:1]).log_likelihood[0], rel=1e-9)


@pytest.mark.parametrize("method", ["gepf", *BASELINES])
def test_nothing_likely_does_not_end_it(method: str) -> None:
    """If every likelihood is zero, all hypotheses have the same weight and continue."""

    def nothing(poses: Array) -> Refined:
        return Refined(poses, np.full(len(poses), -np.inf), np.full(len(poses), np.inf))

    begin = METHODS[method].begin
    first = begin(hinges(), np.zeros(2), SETTINGS)
    found = advance(method, hinges(), first, nothing, SETTINGS, np.random.default_rng(0))
    np.testing.assert_allclose(found.weights, 1.0 / len(found.poses))
    assert np.all(np.isfinite(found.reported))


@given(seeds)
def test_the_mean_lies_between(seed: int) -> None:
    """The mean of a pose and its mirror image about a centre is the centre, balls included."""
    rng, model = np.random.default_rng(seed), puppet()
    centre, step = rng.normal(size=(1, 19)), 0.3 * rng.normal(size=(1, 19))
    poses = np.concatenate([centre, retract(model, centre, step), retract(model, centre, -step)])
    np.testing.assert_allclose(mean_pose(model, poses, np.array([0.2, 0.4, 0.4])), centre[0], atol=1e-9)
    np.testing.assert_allclose(mean_pose(model, poses, np.array([0.0, 1.0, 0.0])), poses[1], atol=1e-6)


CAMERA = Intrinsics(256, 256, 395.0, 395.0, 127.5, 127.5)
FRAMES = 6


@cache
def shown() -> list[Frame]:
    """The arm's first frames, at half the size."""
    images = rendered(human(), arm().poses[:FRAMES], CAMERA)
    units = [np.rint(1000.0 * image).astype(np.uint16) for image in images]
    return [Frame.of(View(n, n / 25.0, image, 1000.0, CAMERA)) for n, image in enumerate(units)]


@pytest.mark.parametrize(("method", "particles"), [("condensation", 150), ("annealed", 20)])
def test_an_arm_is_followed(method: str, particles: int) -> None:
    """From the true start, four angles stay within 8 degrees on average, and few hypotheses are recorded."""
    settings = settings_for(method, "default", particles, 1000)
    start = pose_by_name(human(), arm().poses[0])
    tracker = OnePerson(DirectRefiner(), settings, choose_bodies(ARM_DOFS, "default"), start=start)
    estimates = [tracker.track(frame) for frame in shown()]
    columns = [human().dof_names.index(name) for name in tracker.model.dof_names]
    poses: Array = np.array([estimate.pose for estimate in estimates])
    errors = np.rad2deg(np.abs(poses - arm().poses[:FRAMES, columns]))
    assert errors.mean() < 8.0
    assert all(
        0 < len(e.hypothesis_weight) <= min(particles, CertaintySettings().max_hypotheses) for e in estimates
    )
    assert tracker.start.noise.depth < 0.01
