"""How likely people are to hold their arms in a pose, judged by the poses in which people are searched for.

It decides between hypotheses that explain a frame about equally well, such as an arm behind the back and one
that passes through the chest. The refinement of a hypothesis does not depend on it.

The angles of an arm have a multivariate Student's t distribution around their mean, in relative motion. Its
tails are wide: recorded motion does not show everything that people do. It says nothing about legs. They are
rarely in doubt, and recorded motion has no lunges, against which it would decide. As the likelihood of depth
is tempered, so is the prior: at full weight it would prefer the usual pose to the one that depth shows.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.kinematics import difference, retract
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, shape_space
from gepf.coordinator.bodies.human.typical_poses import people_poses

ARM = ("shoulder_flexion", "shoulder_abduct", "shoulder_twisting", "elbow_flexion")
TAILS = 4.0  # degrees of freedom of the distribution; few: wide tails
TEMPER = 0.4  # share of its nats that counts; chosen on clothed people and the same motions in swimwear
POSES, MEAN_STEPS = 500, 4  # enough for the moments


class ArmPrior(NamedTuple):
    """The distribution of the angles of an arm; left and right have the same."""

    mean: Array  # (4,)
    precision: Array  # (4, 4)


def log_density(model: BodyModel, poses: Array) -> Array:
    """Tempered log density (N,) of poses (N, D), up to a constant; of arms whose four angles can change."""
    total, (arms, mean) = np.zeros(len(poses)), arms_and_mean(model)
    if not arms:
        return total
    away, precision = difference(model, mean, poses), arm_prior().precision
    for dofs in arms:
        own = away[:, dofs]
        squared = np.sum((own @ precision) * own, axis=1)
        total -= 0.5 * TEMPER * (TAILS + len(dofs)) * np.log1p(squared / TAILS)
    return total


@lru_cache(maxsize=16)
def arms_and_mean(model: BodyModel) -> tuple[list[list[int]], Array]:
    """The indices of the angles of each arm, and the pose (1, D) with the mean arms, otherwise zero."""
    arms = [dofs for side in ("l", "r") if (dofs := arm_dofs(model, side))]
    mean = np.zeros((1, len(model.dof_names)))
    for dofs in arms:
        mean[:, dofs] = arm_prior().mean
    return arms, mean


def arm_dofs(model: BodyModel, side: str) -> list[int]:
    """The indices of the angles of an arm; empty if any of them is held."""
    names = [f"{side}_{angle}" for angle in ARM]
    return [model.dof(name) for name in names] if set(names) <= set(model.dof_names) else []


@cache
def arm_prior() -> ArmPrior:
    """The distribution of the arms of recorded poses, left and right."""
    person = shape_space().person(REFERENCE_STATURE, 1.0)
    names = (*ROOT_DOFS, *(f"{side}_{angle}" for side in ("l", "r") for angle in ARM))
    model = activate(person, names, np.zeros(len(person.dof_names)))
    recorded, (left, right) = people_poses(model, POSES), (arm_dofs(model, side) for side in ("l", "r"))
    poses = np.zeros((2 * len(recorded), len(names)))
    poses[:, left] = np.concatenate([recorded[:, left], recorded[:, right]])
    mean = poses[:1]
    for _ in range(MEAN_STEPS):
        mean = retract(model, mean, difference(model, mean, poses).mean(axis=0)[None])
    covariance = np.cov(difference(model, mean, poses)[:, left].T)
    return ArmPrior(mean[0, left], np.asarray(np.linalg.inv(covariance), np.float64))
