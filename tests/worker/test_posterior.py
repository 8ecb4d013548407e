"""One log posterior: what the descent climbs is what the weight is, prior, free space and all.

The kernel's equations and its weights are held against `tests/support/kernel/held_posterior.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from common.activation import activate
from common.body import ROTATION, BodyModel
from common.camera import Intrinsics
from common.frame import EMPTY, HIDDEN, SUBJECT, UNMEASURED, DepthFrame, SubjectFrame
from common.kinematics import pose_vertices
from common.settings import RefineSettings
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes.arm import MOVING
from coordinator.synthesis.scenes.noise import add_noise
from coordinator.tracking.observing.sensor_noise import SensorNoise
from coordinator.tracking.observing.subject import isolate
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.kernel.held_posterior import Held, hold, log_posterior, slope
from tests.support.kernel.kernel_cases import DEFAULT, PAPER
from worker.kernel.icp import solver_parameters
from worker.kernel.job import refine
from worker.kernel.observation import observe
from worker.kernel.packing import pack_observation, pack_parameters
from worker.kernel.search.warm_start import find_correspondences
from worker.kernel.soft.fisher_scoring import fill_soft_equations
from worker.kernel.soft.responsibilities import sample_distance
from worker.kernel.soft.samples import sample
from worker.kernel.solver.gauss_newton import fill_equations
from worker.kernel.solver.priors import clamp_to_limits
from worker.kernel.surface import pack_model
from worker.kernel.visibility import update_visibility
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import make_workspace

Array = NDArray[np.float64]

POSES, FEW = 200, 6
EXACT = 1e-4  # of the slope's length
CAMERA = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
POINTS = 800
FAR, NEAR = 0.3, 0.03  # radians and metres: how far the random poses are off
STANDING = {"root_tz": 2.9, "r_shoulder_flexion": 0.9, "r_shoulder_abduct": 0.7, "r_elbow_flexion": 1.1}
CLEAN, HEAVY = SensorNoise(0.004, 0.004), SensorNoise(0.15, 0.01)
ROOM = "in a room"
SETTINGS = {
    "default": DEFAULT,
    ROOM: DEFAULT,
    "other noise along than across": msgspec.structs.replace(DEFAULT, noise_depth=0.015, noise_lateral=0.008),
    "paper": PAPER,
    "soft": msgspec.structs.replace(DEFAULT, noise_depth=HEAVY.depth, noise_lateral=HEAVY.lateral),
}
BODIES = ("person", "arm")


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A body before a camera, and what is asked about it."""

    model: BodyModel
    truth: Array  # (D,)
    subject: SubjectFrame
    settings: RefineSettings


@cache
def case(body: str, name: str) -> Case:
    """The person with all of the usual degrees of freedom, or with the paper's arm alone, seen with noise."""
    whole, settings = human(), SETTINGS[name]
    model = activate(whole, MOVING if body == "arm" else DEFAULT_ACTIVE, name_pose(whole, STANDING))
    truth = np.array([STANDING.get(dof, 0.0) for dof in model.dof_names])
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(model, truth[None])[0], model.triangles).astype(np.float64)
    noise = HEAVY if settings.is_soft else CLEAN
    noisy = add_noise(depth, CAMERA, noise, np.random.default_rng(0))
    subject = isolate(DepthFrame(0, 0.0, np.rint(noisy * 1e4).astype(np.uint16), 1e4, CAMERA), None, POINTS)
    assert subject is not None
    return Case(model, truth, in_a_room(subject) if name == ROOM else subject, settings)


def in_a_room(subject: SubjectFrame) -> SubjectFrame:
    """The frame with patches beside the subject of which the camera measured nothing, or something nearer."""
    rng, depth = np.random.default_rng(2), subject.frame.depth
    patches = rng.choice([EMPTY, EMPTY, UNMEASURED, HIDDEN], size=-(-np.array(depth.shape) // 6))
    beside = np.kron(patches, np.ones((6, 6), dtype=np.uint8))[: depth.shape[0], : depth.shape[1]]
    kinds = np.where(depth > 0, SUBJECT, beside).astype(np.uint8)
    return replace(subject, kinds=kinds, emptiness=0.4)


def random_poses(of: Case, count: int) -> Array:
    """Poses (count, D) around the truth, near and far; single axes within their limits, balls beyond, too."""
    rng, turning = np.random.default_rng(1), of.model.kinds == ROTATION
    spread = np.where(turning, FAR, NEAR) * rng.uniform(0.1, 1.0, size=(count, 1))
    poses: Array = of.truth + spread * rng.normal(size=(count, len(of.truth)))
    for pose in poses:
        clamp_to_limits(pack_model(of.model)[0], pose)
    return poses


def kernel_slope(of: Case, pose: Array) -> tuple[Array, Held]:
    """Minus the right side of the descent's equations as a slope (D,) of the log posterior; what it held."""
    skeleton, surface = pack_model(of.model)
    packed, parameters = pack_observation(observe(of.subject), of.settings), pack_parameters(of.settings)
    workspace = make_workspace(skeleton, surface, packed)
    equations = workspace.equations
    if parameters.soft:
        fill_soft_equations(pose, skeleton, surface, packed, parameters, workspace)
        grid = sample(workspace.visibility, surface, sample_distance(parameters), workspace.samples)
        scale = of.settings.independent_points / of.settings.noise_lateral**2
        held = hold(of.model, pose, of.subject, of.settings, grid)
        return -scale / packed.count * equations.gradient, held
    visible = update_visibility(pose, skeleton, surface, workspace.transforms, workspace.visibility)
    find_correspondences(visible, 0, surface, packed, parameters, workspace)
    accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
    equations.reference[:] = workspace.transforms[:-1]
    fill_equations(skeleton, pose, solver_parameters(parameters, packed.count), equations)
    scale = of.settings.likelihood_scale**2
    return -equations.gradient / (packed.count * scale), hold(of.model, pose, of.subject, of.settings)


def slope_errors(of: Case, count: int) -> Array:
    """How far the descent's slope is off (count,), of that of the log posterior."""
    errors = []
    for pose in random_poses(of, count):
        mine, held = kernel_slope(of, pose.copy())
        exact = slope(held, pose)
        errors.append(np.linalg.norm(mine - exact) / np.linalg.norm(exact))
    return np.array(errors)


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_the_descent_climbs_the_log_posterior(body: str, name: str) -> None:
    """Its right side is the log posterior's slope by finite differences, to 1e-4, at poses near and far."""
    assert slope_errors(case(body, name), FEW).max() < EXACT


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_the_descent_climbs_the_log_posterior_of_many_poses(body: str, name: str) -> None:
    """The same at 200 poses."""
    assert slope_errors(case(body, name), POSES).max() < EXACT


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("body", BODIES)
def test_every_weight_is_the_log_posterior_of_the_pose_that_comes_with_it(body: str, name: str) -> None:
    """Of 200 refined particles: by what is visible in the pose itself, and belongs together there."""
    of = case(body, name)
    refined = refine(of.model, observe(of.subject), random_poses(of, POSES), of.settings)
    for pose, weight in zip(refined.poses, refined.log_likelihood, strict=True):
        held = kernel_slope(of, pose.copy())[1]
        assert weight == pytest.approx(log_posterior(held, pose[None])[0], rel=1e-3)


def test_far_from_rest_is_less_likely() -> None:
    """Of two poses that explain a frame alike, the one nearer to rest weighs more, by what the prior says."""
    model, near, far = puppet(), np.zeros(19), np.zeros(19)
    far[model.dof("head_nod")] = 0.5
    settings = msgspec.structs.replace(DEFAULT, pose_deviation=0.8)
    costs = [plain_path.prior_cost(model, pose, settings) for pose in (near, far)]
    nats = -0.5 * np.diff(costs)[0] / settings.likelihood_scale**2
    assert nats == pytest.approx(-0.5 * (0.5 / 0.8) ** 2)
