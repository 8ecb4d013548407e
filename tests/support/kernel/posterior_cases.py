"""A person and an arm before a camera, and random poses of them, about which the posterior is asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import ROTATION, BodyModel
from common.camera import Intrinsics
from common.frame import EMPTY, HIDDEN, SUBJECT, UNMEASURED, DepthFrame, SubjectFrame
from common.kinematics import pose_vertices, within_limits
from common.settings import RefineSettings
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.noise import add_noise
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.tracking.observing.sensor_noise import SensorNoise
from coordinator.tracking.observing.subject import isolate
from tests.support.kernel.kernel_cases import DEFAULT, PAPER

Array = NDArray[np.float64]

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
class PosteriorCase:
    """A body before a camera, and what is asked about it."""

    model: BodyModel
    truth: Array  # (D,)
    subject: SubjectFrame
    settings: RefineSettings


@cache
def posterior_case(body: str, name: str) -> PosteriorCase:
    """The person with all of the usual degrees of freedom, or with the paper's arm alone, seen with noise."""
    whole, settings = human(), SETTINGS[name]
    model = activate(whole, ARM_DOFS if body == "arm" else DEFAULT_ACTIVE, name_pose(whole, STANDING))
    truth = np.array([STANDING.get(dof, 0.0) for dof in model.dof_names])
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(model, truth[None])[0], model.triangles).astype(np.float64)
    noise = HEAVY if settings.is_soft else CLEAN
    noisy = add_noise(depth, CAMERA, noise, np.random.default_rng(0))
    subject = isolate(DepthFrame(0, 0.0, np.rint(noisy * 1e4).astype(np.uint16), 1e4, CAMERA), None, POINTS)
    assert subject is not None
    return PosteriorCase(model, truth, in_a_room(subject) if name == ROOM else subject, settings)


def in_a_room(subject: SubjectFrame) -> SubjectFrame:
    """The frame with patches beside the subject of which the camera measured nothing, or something nearer."""
    rng, depth = np.random.default_rng(2), subject.frame.depth
    patches = rng.choice([EMPTY, EMPTY, UNMEASURED, HIDDEN], size=-(-np.array(depth.shape) // 6))
    beside = np.kron(patches, np.ones((6, 6), dtype=np.uint8))[: depth.shape[0], : depth.shape[1]]
    kinds = np.where(depth > 0, SUBJECT, beside).astype(np.uint8)
    return replace(subject, kinds=kinds, emptiness=0.4)


def random_poses(of: PosteriorCase, count: int) -> Array:
    """Poses (count, D) around the truth, near and far; single axes within their limits, balls beyond, too."""
    rng, turning = np.random.default_rng(1), of.model.kinds == ROTATION
    spread = np.where(turning, FAR, NEAR) * rng.uniform(0.1, 1.0, size=(count, 1))
    return within_limits(of.model, of.truth + spread * rng.normal(size=(count, len(of.truth))))
