"""How likely the arms of people are held in a pose, by the poses in which people are searched for.

It decides between hypotheses that explain a frame about equally well, such as an arm behind the back and one
that passes through the chest. The refinement of a hypothesis does not depend on it.

Each arm has a multivariate Student's t distribution around the mean pose, in relative motion. Its tails are
wide: recorded motion does not show everything that people do. It says nothing about legs. They are rarely in
doubt, and recorded motion has no lunges, against which it would decide. As the likelihood of depth is
tempered, so is the prior: its whole weight prefers the usual pose to a visible one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics import difference, retract
from gepf.coordinator.bodies.human.typical_poses import people_poses

ARM = ("shoulder_flexion", "shoulder_abduct", "shoulder_twisting", "elbow_flexion")
SIDES = {"l": "r", "r": "l"}
TAILS = 4.0  # degrees of freedom of the distribution; few: wide tails
TEMPER = 0.4  # share of its nats that counts; chosen on clothed people and the same motions in swimwear
POSES, MEAN_STEPS = 500, 4  # that are enough for its moments


class ArmPrior(NamedTuple):
    """The distribution of the angles of an arm around the mean pose."""

    dofs: list[int]
    precision: Array  # (4, 4)


class ArmPriors(NamedTuple):
    """The mean pose (D,), and the distributions of the arms that can move freely."""

    mean: Array
    arms: tuple[ArmPrior, ...]


def log_density(model: BodyModel, poses: Array) -> Array:
    """Tempered log density (N,) of the arms of poses (N, D), up to a constant."""
    mean, arms = arm_priors(model)
    away, total = difference(model, mean[None], poses), np.zeros(len(poses))
    for dofs, precision in arms:
        own = away[:, dofs]
        squared = np.sum((own @ precision) * own, axis=1)
        total -= 0.5 * TEMPER * (TAILS + len(dofs)) * np.log1p(squared / TAILS)
    return total


@lru_cache(maxsize=64)
def arm_priors(model: BodyModel) -> ArmPriors:
    """The distributions of recorded poses and of their mirror images."""
    names, recorded = list(model.dof_names), people_poses(model, POSES)
    mirrored = [SIDES.get(name[0], "") + name[1:] for name in names]
    swapped = [names.index(other) if other in names else n for n, other in enumerate(mirrored)]
    poses, mean = np.concatenate([recorded, recorded[:, swapped]]), np.zeros((1, len(names)))
    for _ in range(MEAN_STEPS):
        mean = retract(model, mean, difference(model, mean, poses).mean(axis=0)[None])
    away, arms = difference(model, mean, poses), list[ArmPrior]()
    for side in SIDES:
        angles = [f"{side}_{angle}" for angle in ARM]
        if set(angles) <= set(names):
            dofs = [names.index(angle) for angle in angles]
            arms.append(ArmPrior(dofs, np.asarray(np.linalg.inv(np.cov(away[:, dofs].T)), np.float64)))
    return ArmPriors(mean[0], tuple(arms))
