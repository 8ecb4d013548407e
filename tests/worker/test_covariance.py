"""How sure a refined pose is: by the Gauss-Newton matrix of the log posterior, written down in numpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel
from gepf.common.refinement import (
    KEYPOINT_OUTLIER,
    KEYPOINT_WEIGHT,
    Particles,
    lower_triangular,
    triangle_size,
)
from gepf.common.settings import RefineSettings
from gepf.coordinator.filters.priors import pose_prior
from gepf.worker.kernel.gauss_newton import fill_covariance_root, solve
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import observe
from gepf.worker.kernel.parameters import LIMIT_WEIGHT_M2
from gepf.worker.kernel.surface import Surface
from gepf.worker.kernel.visibility import DepthImage, draw
from gepf.worker.lanes import Lanes
from tests.support.answers import as_bytes
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.equations import KernelAt
from tests.support.kernel.kernel_cases import DEFAULT, PAPER, TRUTH, out_of_sight, starts, subject, tangents
from tests.support.kernel.posterior import (
    BODIES,
    SETTINGS,
    Held,
    PosteriorCase,
    Samples,
    hold,
    keypoint_offsets,
    log_density,
    posterior_case,
    random_poses,
)

POSES = 3


def widest(model: BodyModel) -> Array:
    """Deviations (D,) without any information."""
    return np.where(model.kinds == ROTATION, np.radians(30.0), 0.05)


def kernel_covariance(of: PosteriorCase, pose: Array) -> tuple[Array, Array]:
    """The kernel's covariance (D, D) at a pose (D,), and the expected one."""
    kernel = KernelAt.make(of, pose)
    problem, equations = kernel.view.problem, kernel.view.workspace.equations
    if of.settings.is_soft:
        exact = soft_information(
            of, pose, (draw(problem.surface.triangles, True, kernel.view.workspace), problem.surface)
        )
    else:
        exact = hard_information(of, pose) + keypoint_information(of, pose)
    kernel.linearise()
    solve(pose.copy(), problem.parameters.icp.damping, problem, equations)
    triangle = np.empty(triangle_size(len(pose)), np.float32)
    fill_covariance_root(problem, equations, triangle)
    root = lower_triangular(triangle[None], len(pose))[0]
    return root @ root.T, np.asarray(np.linalg.inv(exact + np.diag(widest(of.model) ** -2.0)))


def hard_information(of: PosteriorCase, pose: Array) -> Array:
    """J^T W J (D, D) in units of the log posterior, with its prior."""
    model, settings, count = of.model, of.settings, len(of.subject.largest.picked)
    posed, visible = plain_path.visible_vertices(model, pose)
    factors = plain_path.weigh_correspondences(model, pose, posed, visible, of.subject, settings)
    gram, gradient = plain_path.equations(model, factors, pose, settings)
    gram, gradient = plain_path.add_rest_prior(
        model, pose, plain_path.rest_weight(settings) * count, gram, gradient
    )
    gram, _ = plain_path.add_limit_prior(model, pose, LIMIT_WEIGHT_M2 * count, gram, gradient)
    return gram / count / settings.likelihood_scale**2


def keypoint_information(of: PosteriorCase, pose: Array) -> Array:
    """J^T W J (D, D) of the keypoints, of which W has the robust weights at the pose."""
    if of.subject.largest.keypoints is None:
        return np.zeros((len(pose), len(pose)))
    slopes = tangents(of.model, pose, lambda at: keypoint_offsets(of.model, at[None], of.subject)[0])
    squared = of.subject.largest.keypoints[:, 2] * np.sum(
        keypoint_offsets(of.model, pose[None], of.subject)[0] ** 2, axis=1
    )
    weights = (
        of.subject.largest.keypoints[:, 2] * (KEYPOINT_OUTLIER**2 / (KEYPOINT_OUTLIER**2 + squared)) ** 2
    )
    return np.asarray(KEYPOINT_WEIGHT * np.einsum("kad,k,kae->de", slopes, weights, slopes))


def soft_information(of: PosteriorCase, pose: Array, drawn: tuple[DepthImage, Surface]) -> Array:
    """The mean outer product of the points' slopes, by finite differences, for the independent ones.

    What a point says of one link is taken apart from what it says of another, as in scoring.
    """
    held, model, settings = hold(of.model, pose, of.subject, of.settings, drawn), of.model, of.settings
    assert held.samples is not None
    samples, count = held.samples, len(held.points)
    total, gram = np.exp(log_density(held, samples, pose[None])[0]), np.zeros((len(pose), len(pose)))
    for link in np.unique(samples.links):
        of_link = replace(samples, angles=np.where(samples.links == link, samples.angles, 0.0))
        slopes = tangents(model, pose, density_of(held, of_link)) / total[:, None]  # (P, D)
        gram += slopes.T @ slopes
    stiffness = LIMIT_WEIGHT_M2 * count
    gram, _ = plain_path.add_limit_prior(model, pose, stiffness, gram, np.zeros(len(pose)))
    return gram * settings.independent_points / count


def density_of(held: Held, samples: Samples) -> Callable[[Array], Array]:
    """Densities (P,) of the points by some samples, carried along to a pose (D,)."""
    return lambda at: np.exp(log_density(held, samples, at[None])[0])


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_it_is_the_inverse_of_the_log_posteriors_curvature(body: str, name: str) -> None:
    """For random poses, some at limits: neither damping nor what a limit holds is in it."""
    of = posterior_case(body, name)
    for pose in random_poses(of, POSES):
        found, expected = kernel_covariance(of, pose)
        scale = np.sqrt(np.diag(expected))
        both = np.outer(scale, scale)
        np.testing.assert_allclose(found / both, expected / both, atol=2e-3)
        assert np.min(scale / widest(of.model)) < 0.5


@pytest.mark.parametrize("settings", [DEFAULT, PAPER])
def test_a_descent_that_came_to_rest_gives_that_of_its_pose(settings: RefineSettings) -> None:
    """The whole way through a request, for poses that stay where they are."""
    model, observation = puppet(), observe(subject())
    long, short = (msgspec.structs.replace(settings, icp_iterations=n) for n in (60, 1))
    prior = pose_prior(model, settings)
    settled = refine(model, observation, Particles(starts(3), long, prior=prior)).poses
    again = refine(model, observation, Particles(settled, short, covariance=True, prior=prior))
    assert again.covariance_roots is not None
    roots = lower_triangular(again.covariance_roots, len(TRUTH))
    for pose, root in zip(settled, roots, strict=True):
        of = PosteriorCase(model, pose, subject(), short)
        expected = np.linalg.inv(hard_information(of, pose) + np.diag(widest(model) ** -2.0))
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(root @ root.T / scale, expected / scale, atol=0.02)


def test_what_nothing_is_known_about_has_the_weak_priors_width() -> None:
    """Without a descent, and for a body out of sight."""
    still = msgspec.structs.replace(DEFAULT, icp_iterations=0)
    for body, pose, settings in ((puppet(), TRUTH, still), (*out_of_sight(), PAPER)):
        found = refine(
            body, observe(subject()), Particles(pose[None], settings, covariance=True)
        ).covariance_roots
        assert found is not None
        np.testing.assert_allclose(lower_triangular(found, 19)[0], np.diag(widest(body)), rtol=1e-6)


@pytest.mark.parametrize("name", ["default", "soft"])
def test_it_depends_on_the_particle_alone(name: str) -> None:
    """The same bytes alone, in any batch and order and over lanes; asking for it changes nothing else."""
    model, observation, settings, poses = puppet(), observe(subject()), SETTINGS[name], starts(7)
    together = refine(model, observation, Particles(poses, settings, covariance=True))
    unasked = refine(model, observation, Particles(poses, settings))
    assert as_bytes(unasked) == as_bytes(replace(together, covariance_roots=None))
    backward = refine(model, observation, Particles(poses[::-1], settings, covariance=True))
    assert as_bytes(backward)[::-1] == as_bytes(together)
    for n in range(3):
        alone = refine(model, observation, Particles(poses[n : n + 1], settings, covariance=True))
        assert as_bytes(alone) == as_bytes(together)[n : n + 1]
    of_lanes = Lanes(2).refine(model, observation, Particles(poses, settings, covariance=True))
    assert as_bytes(of_lanes) == as_bytes(together)
