"""The whole descent matches the plain path, independent of padding and of the number of lanes."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import msgspec
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from gepf.common.camera import Intrinsics
from gepf.common.kinematics import retract
from gepf.common.refinement import Particles
from gepf.coordinator.filters.priors import pose_prior
from gepf.worker.kernel import icp
from gepf.worker.kernel.gauss_newton import solve_ltl
from gepf.worker.kernel.icp import Batch, refine, refine_some
from gepf.worker.kernel.observation import Observation, observe, pack_views
from gepf.worker.lanes import Lanes
from tests.support.answers import as_bytes
from tests.support.bodies import person, puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import (
    DEFAULT,
    PAPER,
    POINTS,
    SETTINGS,
    TRUTH,
    out_of_sight,
    starts,
    subject,
)
from tests.support.people import subject_of


@pytest.mark.parametrize("name", SETTINGS)
def test_refinement_matches(name: str) -> None:
    """The whole descent and its likelihood match to 1e-6, as a rule.

    Where two model points are equally close, single against double precision may choose another one, which
    moves a pose by a thousandth at the most.
    """
    model, settings = puppet(), SETTINGS[name]
    poses = starts(3)
    prior = pose_prior(model, settings)
    found = icp.refine(model, observe(subject()), Particles(poses, settings, prior=prior))
    expected = [plain_path.refine(model, subject(), pose, settings) for pose in poses]
    off = np.abs(found.poses - np.array([pose for pose, _, _ in expected])).max(axis=1)
    assert np.median(off) < 1e-6
    assert off.max() < 1e-3
    matching = off < 1e-6
    log_likelihood, residual = np.array([rest for _, *rest in expected]).T
    np.testing.assert_allclose(found.log_likelihood[matching], log_likelihood[matching], rtol=1e-5)
    np.testing.assert_allclose(found.residual[matching], residual[matching], rtol=1e-5)
    assert np.abs(found.poses - poses).max() > 0.1


def test_without_iterations_poses_are_only_evaluated() -> None:
    """No ICP iteration: poses stay, within their limits, and are as likely as after a descent to them."""
    model, observation = puppet(), observe(subject())
    refined = icp.refine(model, observation, Particles(starts(3), DEFAULT))
    assess = msgspec.structs.replace(DEFAULT, icp_iterations=0)
    assessed = icp.refine(model, observation, Particles(refined.poses, assess))
    np.testing.assert_array_equal(assessed.poses, refined.poses)
    np.testing.assert_array_equal(assessed.log_likelihood, refined.log_likelihood)
    np.testing.assert_array_equal(assessed.residual, refined.residual)


def test_a_descent_ends_when_a_step_is_small() -> None:
    """Any number of further iterations gives the same bytes."""
    some, more = (
        icp.refine(puppet(), observe(subject()), Particles(starts(3), settings)).poses
        for settings in (msgspec.structs.replace(DEFAULT, icp_iterations=n) for n in (60, 120))
    )
    np.testing.assert_array_equal(some, more)


def test_padding_does_not_count() -> None:
    """Points of the observation beyond its count do not change any result."""
    observation = observe(subject())
    (view,) = observation.views
    assert view.count == POINTS < len(view.points)
    points = view.points.copy()
    points[POINTS:] = points[:1] + np.float32(0.5)
    for settings in (PAPER, DEFAULT):
        one = icp.refine(puppet(), observation, Particles(starts(2), settings))
        moved = Observation((replace(view, points=points),))
        other = icp.refine(puppet(), moved, Particles(starts(2), settings))
        np.testing.assert_allclose(other.poses, one.poses, atol=1e-9)
        np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=1e-9)
        np.testing.assert_allclose(other.residual, one.residual, rtol=1e-9)


def test_a_body_that_is_nowhere_in_sight_is_impossible() -> None:
    """Behind the camera nothing is visible: the pose stays, its likelihood is zero, its residual infinite."""
    model, behind = out_of_sight()
    found = icp.refine(model, observe(subject()), Particles(behind[None], PAPER))
    np.testing.assert_array_equal(found.poses[0], behind)
    assert found.log_likelihood[0] == -np.inf
    assert found.residual[0] == np.inf


def test_what_nothing_determines_stays() -> None:
    """Without damping: steps of a singular system are finite, solve it, and leave the undetermined alone."""
    jacobian = np.random.default_rng(0).normal(size=(3, 5)) * [1.0, 1.0, 0.0, 1.0, 1.0]
    gram, target = jacobian.T @ jacobian, jacobian.T @ np.array([0.3, -0.2, 0.1])
    step = target.copy()
    solve_ltl(np.arange(-1, 4), gram.copy(), step)
    assert step[2] == 0.0
    assert np.abs(step).max() < 100.0
    np.testing.assert_allclose(gram @ step, target, atol=1e-9)


def test_nothing_compiles_in_mid_run() -> None:
    """After the first particle no kernel is compiled for other bodies, frames, batches or settings."""
    icp.refine(puppet(), observe(subject()), Particles(starts(1), PAPER))
    retract(puppet(), starts(1), starts(1))
    pose = np.zeros((2, len(person().dof_names)))
    gc.unfreeze()  # a worker in this process would have hidden them
    kernels = [
        k for k in gc.get_objects()
        if isinstance(k, Dispatcher) and k.py_func.__module__.startswith(("gepf.worker.", "gepf.common."))
    ]  # fmt: skip
    before = {k.py_func.__qualname__: len(k.signatures) for k in kernels}
    assert len(before) > 20
    pose[:, 2] = 2.0
    few = subject_of(plain_path.render(puppet(), TRUTH, Intrinsics(90, 80, 80.0, 80.0, 45.0, 40.0)), 70)
    for settings in SETTINGS.values():
        icp.refine(person(), observe(few), Particles(pose, settings))
    retract(person(), pose, pose)
    assert {k.py_func.__qualname__: len(k.signatures) for k in kernels} == before
    assert len(icp.refine_one.signatures) == 1


@pytest.mark.parametrize("lanes", [1, 3])
def test_any_number_of_lanes_gives_the_same_bytes(lanes: int) -> None:
    """Fewer, as many and more particles than lanes, with either preset; the given poses stay as they are."""
    observation = observe(subject())
    side_by_side = Lanes(lanes)
    for particles in (1, lanes, 20):
        for settings in (PAPER, DEFAULT):
            given = Particles(starts(particles), settings)
            given.poses.setflags(write=False)
            alone = refine(puppet(), observation, given)
            together = side_by_side.refine(puppet(), observation, given)
            assert as_bytes(together) == as_bytes(alone)
            np.testing.assert_array_equal(given.poses, starts(particles))


def test_what_is_prepared_ahead_changes_nothing() -> None:
    """For the settings of the request to come, or for others: the same bytes as without."""
    side_by_side = Lanes(2)
    for prepared in (DEFAULT, msgspec.structs.replace(DEFAULT, noise_depth=10.0 * DEFAULT.noise_depth)):
        observation = observe(subject())
        pack_views(observation, prepared)
        together = side_by_side.refine(puppet(), observation, Particles(starts(5), DEFAULT))
        assert as_bytes(together) == as_bytes(
            refine(puppet(), observe(subject()), Particles(starts(5), DEFAULT))
        )


@pytest.mark.parametrize("faulty", [0, 1, 2])
def test_what_a_lane_raises_comes_out_and_the_next_request_is_served(
    faulty: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other lanes have returned by then."""
    lanes, observation = Lanes(3), observe(subject())
    entered, returned = count(), list[int]()

    def fail(batch: Batch, particles: Iterator[int]) -> None:
        lane = next(entered)
        if lane == faulty:
            raise ZeroDivisionError
        refine_some(batch, particles)
        returned.append(lane)

    with monkeypatch.context() as patch:
        patch.setattr("gepf.worker.lanes.refine_some", fail)
        with pytest.raises(ZeroDivisionError):
            lanes.refine(puppet(), observation, Particles(starts(40), DEFAULT))
    assert sorted([*returned, faulty]) == [0, 1, 2]
    together = lanes.refine(puppet(), observation, Particles(starts(5), DEFAULT))
    assert as_bytes(together) == as_bytes(refine(puppet(), observation, Particles(starts(5), DEFAULT)))
