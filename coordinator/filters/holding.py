"""Hypotheses held between what a frame shows of them and where motion leads them (preset `default`).

The descent climbs what one frame says. Of a limb that it does not show that is the prior of joint angles
alone, which takes it to rest within a few frames. So each hypothesis is set to where the posterior of both
is greatest: the frame's, a Gaussian with the covariance that the descent found (less the weak prior that is
in it), and motion's, a Gaussian about the pose that its ancestor was expected in. What is seen stays where
it is seen, what is hidden where motion left it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.kinematics import difference, retract, within_limits
from common.refinement import WEAK_SLIDE, WEAK_TURN
from coordinator.filters.sighting import USUAL_INTERVAL

Array = NDArray[np.float64]

UNEXPECTED_TURN, UNEXPECTED_SLIDE = float(np.radians(15.0)), WEAK_SLIDE
"""Standard deviations, radians and metres, of how joints move in a usual interval beside what is expected."""


class Stiffness(NamedTuple):
    """What holds degrees of freedom (D,) beside what is seen: inverse variances, and which are which."""

    weak: Array  # of the weak prior
    moves: Array  # of motion in a usual interval, of what does not place the base
    base: NDArray[np.bool_]  # what places the base


def hold(model: BodyModel, refined: Array, found: Array, expected: Array, interval: float) -> Array:
    """The likeliest poses (M, D) given a frame and the motion of so many seconds before it.

    With the covariance S = (L + W)^-1 of a refined pose, L what the frame says and W the weak prior's
    precision, and P that of motion, the step from it is (I + S (P - W))^-1 S P times the way to where it
    was expected: L need not be known. Where the base goes is left to the frame, and to the weak prior.

    Args:
        model: The body.
        refined: Hypotheses (M, D) after their descent.
        found: Their covariances (M, D, D).
        expected: Where they would be (M, D) had all gone on as it went.
        interval: Seconds since then.
    """
    of = stiffness_of(model)
    motion: Array = np.where(of.base, of.weak, of.moves / interval)
    way: Array = np.where(of.base, 0.0, difference(model, refined, expected))
    pull = found @ (motion * way)[..., None]
    matrix: Array = np.eye(len(motion)) + found * (motion - of.weak)
    steps = np.asarray(np.linalg.solve(matrix, pull), dtype=np.float64)
    return within_limits(model, retract(model, refined, steps[..., 0]))


@lru_cache(maxsize=16)
def stiffness_of(model: BodyModel) -> Stiffness:
    """What holds a body's degrees of freedom."""
    turning = model.kinds == ROTATION
    return Stiffness(
        np.where(turning, WEAK_TURN, WEAK_SLIDE) ** -2.0,
        np.where(turning, UNEXPECTED_TURN, UNEXPECTED_SLIDE) ** -2.0 * USUAL_INTERVAL,
        np.isin(model.dof_names, ROOT_DOFS),
    )
