"""Soft correspondences: their density, gradient and information, and what they find under heavy noise."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame
from common.kinematics import link_transforms, pose_vertices, retract
from common.settings import RefineSettings, preset
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.noise import add_noise
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.tracking.observing.sensor_noise import SensorNoise
from coordinator.tracking.observing.subject import isolate
from worker.kernel.icp import refine
from worker.kernel.likelihood import mean_log_density
from worker.kernel.observation import Observation, PackedObservation, observe, pack_observation
from worker.kernel.parameters import KernelParameters, pack_parameters
from worker.kernel.soft import (
    OUTLIER_DENSITY,
    SampleGrid,
    accumulate_scores,
    decay,
    fill_soft_equations,
    sample,
    sample_distance,
)
from worker.kernel.surface import Skeleton, pack_model
from worker.kernel.workspace import NormalEquations, Workspace, make_workspace

Array = NDArray[np.float64]

CAMERA = Intrinsics(512, 512, 790.0, 790.0, 255.5, 255.5)
STEP = 1e-4  # radians
FEW = 800  # points, where all are held against all samples
NOISE = SensorNoise(0.15, 0.01)
NOISY = msgspec.structs.replace(preset("default").refine, noise_depth=0.15, noise_lateral=0.01)
POSE = {
    "root_tz": 3.08,
    "r_shoulder_flexion": 0.9,
    "r_shoulder_abduct": 0.7,
    "r_shoulder_twisting": -0.2,
    "r_elbow_flexion": 1.1,
}


@cache
def body() -> tuple[BodyModel, Array]:
    """The person with an arm that moves, in front of the camera, and the arm's pose (4,)."""
    model = activate(human(), ARM_DOFS, name_pose(human(), POSE))
    return model, np.array([POSE[name] for name in model.dof_names])


@cache
def seen(seed: int, points: int = 4000) -> Observation:
    """What a camera with heavy noise observes of the pose."""
    model, truth = body()
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(model, truth[None])[0], model.triangles).astype(np.float64)
    noisy = add_noise(depth, CAMERA, NOISE, np.random.default_rng(seed))
    subject = isolate(DepthFrame(0, 0.0, np.rint(noisy * 1e4).astype(np.uint16), 1e4, CAMERA), None, points)
    assert subject is not None
    return observe(subject)


@cache
def packed_up(
    settings: RefineSettings,
) -> tuple[Skeleton, PackedObservation, KernelParameters, Workspace, SampleGrid]:
    """All that the kernel works with, at the true pose."""
    model, truth = body()
    skeleton, surface = pack_model(model)
    packed, parameters = pack_observation(seen(0, FEW), settings), pack_parameters(settings)
    workspace = make_workspace(skeleton, surface, packed)
    fill_soft_equations(truth, skeleton, surface, packed, parameters, workspace)  # poses the surface
    grid = sample(workspace.visibility, surface, sample_distance(parameters), workspace.soft)
    return skeleton, packed, parameters, workspace, grid


def scores() -> NormalEquations:
    """Equations of the points' density alone, at the true pose."""
    skeleton, packed, parameters, workspace, grid = packed_up(NOISY)
    accumulate_scores(grid, skeleton, packed, parameters, workspace.soft, workspace.equations)
    return workspace.equations


def log_density(pose: Array) -> Array:
    """Log p (P,) of each point by numpy from all samples, moved with their links to a pose (4,)."""
    _, packed, parameters, _, grid = packed_up(NOISY)
    model, truth = body()
    rows, columns = np.nonzero(np.isfinite(grid.depth))
    z = grid.depth[rows, columns].astype(np.float64)
    pixel = z / grid.focal
    samples = np.stack([(columns + grid.left) * pixel, (rows + grid.top) * pixel, z], axis=1)
    before, after = (link_transforms(model, p[None])[0][grid.links[rows, columns]] for p in (truth, pose))
    rest = np.einsum("nba,nb->na", before[..., :3], samples - before[..., 3])
    samples = np.einsum("nab,nb->na", after[..., :3], rest) + after[..., 3]
    points = packed.points[:, : packed.count].T.astype(np.float64) / (1.0, 1.0, parameters.stretch)
    found = np.empty(len(points))
    for i, p in enumerate(points):
        across = p[:2] / p[2] * samples[:, 2:] - samples[:, :2]
        squared = (across**2).sum(axis=1) / 0.01**2 + (p[2] - samples[:, 2]) ** 2 / 0.15**2
        found[i] = np.sum(np.exp(-0.5 * squared) * pixel**2 / (2.0 * np.pi * 0.01**2))
    return np.log(found + OUTLIER_DENSITY)


@cache
def slopes() -> Array:
    """Derivative (P, 4) of each point's log density by relative motion, by finite differences."""
    model, truth = body()
    sides = [
        [log_density(retract(model, truth[None], way * STEP * turn[None])[0]) for way in (1, -1)]
        for turn in np.eye(len(truth))
    ]
    return np.stack([(ahead - back) / (2.0 * STEP) for ahead, back in sides], axis=1)


def test_density_is_that_of_all_samples() -> None:
    """Samples within reach hold nearly all of the density: the mean log is that of a plain sum over all."""
    _, packed, parameters, workspace, grid = packed_up(NOISY)
    plain = log_density(body()[1]).mean()
    assert mean_log_density(grid, packed, parameters, workspace.soft) == pytest.approx(plain, abs=0.06)


def test_gradient_is_that_of_the_density() -> None:
    """By finite differences, to a fraction of what chance makes of it: samples out of reach are left out."""
    mine, chance = -scores().gradient / 0.01**2, np.sqrt(np.sum(slopes() ** 2, axis=0))
    np.testing.assert_allclose(mine / chance, slopes().sum(axis=0) / chance, atol=0.25)


def test_information_is_that_of_the_slopes() -> None:
    """Standard deviations that the information promises are what the points' slopes give, within a third."""
    lower = np.tril(scores().gram / 0.01**2)
    mine, plain = (
        np.sqrt(np.diag(np.linalg.inv(information)))
        for information in (lower + np.tril(lower, -1).T, slopes().T @ slopes())
    )
    np.testing.assert_allclose(mine, plain, rtol=0.34)


def test_truth_is_where_the_descent_stays() -> None:
    """Closest points drift off the truth under heavy noise, soft correspondences stay twice as near."""
    model, truth = body()
    soft = msgspec.structs.replace(NOISY, icp_iterations=12)
    hard = msgspec.structs.replace(soft, sensor="distance")
    off = {
        name: np.mean(
            [np.abs(refine(model, seen(seed), truth[None], s).poses[0] - truth).mean() for seed in range(6)]
        )
        for name, s in {"hard": hard, "soft": soft}.items()
    }
    assert off["soft"] < np.radians(1.6)
    assert off["soft"] < off["hard"] / 2.0


def test_a_few_steps_come_near_to_where_many_lead() -> None:
    """From four degrees off three iterations leave 0.65 degrees; damped by the complete information, 1.46."""
    model, truth = body()
    starts = truth + np.radians(5.0) * np.random.default_rng(0).standard_normal((20, len(truth)))
    many = msgspec.structs.replace(NOISY, icp_iterations=40)
    away = []
    for seed in range(3):
        there = refine(model, seen(seed), starts, many)
        best = there.poses[np.argmax(there.log_likelihood)]
        away.append(np.abs(refine(model, seen(seed), starts, NOISY).poses - best).mean())
    assert np.mean(away) < np.radians(1.0)


def test_likelihood_prefers_the_truth() -> None:
    """Of poses a few degrees apart, those near the truth are the likelier."""
    model, truth = body()
    off = np.radians(6.0) * np.random.default_rng(1).standard_normal((20, len(truth)))
    only_assess = msgspec.structs.replace(NOISY, icp_iterations=0)
    found = refine(model, seen(0), np.concatenate([truth[None], truth + off]), only_assess)
    assert np.argmax(found.log_likelihood) == 0


def test_clean_depth_needs_none_of_it() -> None:
    """Where depth is not far noisier than the rest there are none, nor where distances alone count."""
    quiet = preset("default").refine
    hard = msgspec.structs.replace(NOISY, sensor="distance")
    assert [pack_parameters(s).soft for s in (NOISY, quiet, hard)] == [True, False, False]


def test_a_particle_is_on_its_own() -> None:
    """A particle's result does not depend on those refined before it."""
    model, truth = body()
    starts = truth + np.radians(5.0) * np.random.default_rng(2).standard_normal((4, len(truth)))
    together = refine(model, seen(0), starts, NOISY)
    for n in range(len(starts)):
        alone = refine(model, seen(0), starts[n : n + 1], NOISY)
        assert alone.poses[0].tobytes() == together.poses[n].tobytes()
        assert alone.log_likelihood[0] == together.log_likelihood[n]


def test_decay_is_the_exponential() -> None:
    """To 1e-4 of itself, and nothing where hardly anything is left."""
    for x in np.linspace(-15.9, 0.0, 200):
        assert decay(np.float32(x)) == pytest.approx(np.exp(np.float32(x)), rel=2e-4)
    assert decay(np.float32(-20.0)) == 0.0
    assert decay(np.float32(-np.inf)) == 0.0
