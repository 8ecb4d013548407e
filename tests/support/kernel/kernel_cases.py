"""The puppet before a small camera, and stages of the kernel on it, to compare with the plain path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import retract
from gepf.coordinator.settings import preset
from tests.support.bodies import puppet
from tests.support.kernel import plain_path
from tests.support.people import subject_of

CAMERA = Intrinsics(200, 160, 200.0, 210.0, 98.7, 81.2)
TRUTH = np.array(
    [0.02, -0.03, 2.0, 0.1, 0.4, -0.1, 0.1, -0.2, 0.15, 0.3, 0.2, 0.4, -0.4, 0.5, 0.4, 0.2, -0.5, 0.03, 0.2]
)  # of the puppet
POINTS = 1500
PAPER, DEFAULT = preset("paper").refine, preset("default").refine
SETTINGS = {
    "paper": PAPER,
    "default": DEFAULT,
    "other noise along than across": msgspec.structs.replace(DEFAULT, noise_depth=0.015, noise_lateral=0.008),
    "the paper's, accelerated": msgspec.structs.replace(PAPER, descent="accelerated", noise_depth=0.004),
    "camera, plain and rest": msgspec.structs.replace(PAPER, sensor="camera", pose_deviation=0.08),
}


@cache
def subject(model: BodyModel | None = None) -> SubjectFrame:
    """The puppet in front of the camera, picked with padding to spare."""
    return subject_of(plain_path.render(model or puppet(), TRUTH, CAMERA), POINTS)


def starts(count: int) -> Array:
    """Poses (count, 19) around the truth, some of them out of limits."""
    rng = np.random.default_rng(0)
    spread = np.where(puppet().kinds == ROTATION, 0.3, 0.03)
    poses: Array = TRUTH + rng.normal(size=(count, len(TRUTH))) * spread
    return poses


def out_of_sight() -> tuple[BodyModel, Array]:
    """A puppet whose stand is behind the camera, too, and a pose (19,) behind it."""
    model, behind = puppet(), TRUTH.copy()
    behind[2] = -3.0
    stand = model.skin_links[:, :1] == 0
    return replace(model, vertices=model.vertices - stand * np.array([0.0, 0.0, 9.0])), behind


def near() -> Array:
    """A pose (19,) so near the truth that all links have correspondences."""
    return TRUTH + np.where(puppet().kinds == ROTATION, 0.1, 0.01) * np.random.default_rng(1).normal(size=19)


def tangents(model: BodyModel, pose: Array, value: Callable[[Array], Array]) -> Array:
    """Central finite differences (..., D) of a value (...) by every degree of freedom's step."""
    steps = 1e-5 * np.eye(len(pose))
    ahead, behind = (retract(model, np.tile(pose, (len(pose), 1)), s) for s in (steps, -steps))
    return np.stack([(value(a) - value(b)) / 2e-5 for a, b in zip(ahead, behind, strict=True)], axis=-1)
