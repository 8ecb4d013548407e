"""What speaks for and against each joint of a reported pose, in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.compiling import numba
from common.frame import SubjectFrame
from common.kinematics import joint_positions
from coordinator.bodies.angles import is_person
from coordinator.filters.exploration import find_limbs
from coordinator.tracking.certainty.posture import posture_of
from coordinator.tracking.certainty.regions import Regions, regions_of
from coordinator.tracking.certainty.surface import (
    COVERED,
    NEARER,
    SHOWN,
    UNKNOWN,
    VIOLATED,
    Seen,
    see_surface,
)
from coordinator.tracking.certainty.unexplained import unexplained_points

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CLUES = (
    "shown", "covered", "nearer", "violated",
    "limb_shown", "limb_covered", "limb_nearer", "limb_violated",
    "off", "limb_off", "unexplained", "spread", "weak_spread", "limb_spread", "moved", "bent", "lever",
    "body_violated", "folded", "ahead",
)  # fmt: skip
"""Columns of the evidence. Shares of the surface around the joint that faces the camera: shown by the frame,
covered by the body or where the frame does not say, with something nearer before it, standing where
something farther or nothing was measured; their means over the joint's limb. Then, as logarithms: how far the
surface is off what is measured, at worst in the limb, too; the observed surface near by that nothing
explains; the spread of the hypotheses by their weight, with weak ones counting more, at most in the limb; the
motion since the last frame. At last how bent the limb is (rad^2, a person's), how far along it the joint is
(metres), the mean of `violated` over all joints, and a person's posture."""

AROUND = 0.3  # metres within which what is unexplained may be the joint's
WEAKER = 5.0  # log weights are divided by so much for the spread in which weak hypotheses count
USUALLY_BENT = 1.0  # a person's limb: what stands for that of other bodies
LEAST = {"off": 0.005, "unexplained": 0.002, "spread": 0.005, "moved": 0.005}
"""What is added before the logarithm, in metres and square metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """What a frame was reported from, beside the hypotheses."""

    subject: SubjectFrame
    past: Array  # (D,) the pose that was reported before
    interval: float  # seconds since then
    stretch: float  # lateral over depth noise
    lone: bool = False  # a single particle was drawn: that no other hypothesis is left says nothing
    first: bool = False  # nothing was reported before but a guess


class Limbs(NamedTuple):
    """Of each joint the limb (J,), its length up to there in metres (J,), and what turns it (J, D)."""

    of_joint: Indices
    lever: Array
    turns: NDArray[np.bool_]


def weigh_evidence(
    model: BodyModel, pose: Array, hypotheses: Array, weights: Array, sighted: Sighted
) -> Array:
    """The evidence (J, len(CLUES)) about a reported pose (D,) and its hypotheses (M, D) with weights (M,)."""
    limbs = limbs_of(model)
    seen = see_surface(model, pose, sighted.subject, sighted.stretch)
    shares = np.empty((len(limbs.of_joint), 5))
    average_regions(seen, regions_of(model), shares)
    shares, off = shares[:, :4], np.log(shares[:, 4] + LEAST["off"])
    placed = joint_positions(model, np.concatenate([pose[None], sighted.past[None], hypotheses]))
    joints, past, others = placed[0], placed[1], placed[2:]
    if sighted.lone:
        spread = weak = np.full(len(joints), np.log(LONE_SPREAD + LEAST["spread"]))
    else:
        apart = others - joints
        squares = np.einsum("mja,mja->mj", apart, apart)
        spread = np.log(spread_of(squares, weights) + LEAST["spread"])
        weak = np.log(spread_of(squares, weights ** (1.0 / WEAKER)) + LEAST["spread"])
    posture = posture_of(model, joints)
    turned = np.where(limbs.turns, pose**2, 0.0).sum(axis=1)
    columns = [
        *shares.T,
        *mean_of_limb(shares, limbs.of_joint).T,
        off,
        most_of_limb(off, limbs.of_joint),
        np.log(np.where(limbs.of_joint < 0, 0.0, area_left(joints, seen, sighted)) + LEAST["unexplained"]),
        spread,
        weak,
        most_of_limb(spread, limbs.of_joint),
        np.log(np.linalg.norm(joints - past, axis=1) + LEAST["moved"]),
        turned if is_person(model.dof_names) else USUALLY_BENT,
        limbs.lever,
        shares[:, 3].mean(),
        posture.folded,
        posture.ahead,
    ]
    evidence = np.empty((len(joints), len(CLUES)))
    for clue, column in zip(range(len(CLUES)), columns, strict=True):
        evidence[:, clue] = column
    return evidence


@numba.njit(cache=True, nogil=True)
def average_regions(seen: Seen, regions: Regions, out: Array) -> None:
    """Fill out (J, 5): shares that are shown, covered or unknown, behind, violated; how far each is off."""
    for j in range(len(out)):
        total = shown = 0.0
        out[j] = 0.0
        for i in range(regions.starts[j], regions.starts[j + 1]):
            v = regions.vertices[i]
            weight, state = regions.weights[i] * seen.facing[v], seen.states[v]
            total += weight
            if state == SHOWN:
                shown += weight
                out[j, 4] += weight * abs(seen.off[v])
            elif state in (COVERED, UNKNOWN):
                out[j, 1] += weight
            elif state == NEARER:
                out[j, 2] += weight
            elif state == VIOLATED:
                out[j, 3] += weight
        out[j, 0] = shown
        out[j, :4] /= max(total, 1e-12)
        out[j, 4] = out[j, 4] / shown if shown > 0.0 else UNSEEN_OFF


LONE_SPREAD = 0.014
"""Metres, in place of the spread of hypotheses that there are none of: by it a joint's deviation holds on the
hard actions of subjects 1 and 2, as `--method gradient` tracks them at 10 frames a second (72 and 95 % of the
joints that are seen within one and two). What a lone particle adds to the odds is in `assessment`."""

UNSEEN_OFF = 0.08  # metres, of a region that is not shown


def spread_of(squares: Array, weights: Array) -> Array:
    """Root mean (J,) of squared distances (M, J), by weight (M,)."""
    spread: Array = np.sqrt(weights @ squares / weights.sum())
    return spread


@numba.njit(cache=True, nogil=True)
def mean_of_limb(values: Array, of_joint: Indices) -> Array:
    """Values (J, K) of joints, each replaced by its limb's mean."""
    limbs = of_joint.max() + 2  # the last for those of no limb, -1
    sums, counts = np.zeros((limbs, values.shape[1])), np.zeros(limbs)
    for j in range(len(values)):
        counts[of_joint[j]] += 1.0
        for k in range(values.shape[1]):
            sums[of_joint[j], k] += values[j, k]
    out = np.empty(values.shape)
    for j in range(len(values)):
        for k in range(values.shape[1]):
            out[j, k] = sums[of_joint[j], k] / counts[of_joint[j]]
    return out


@numba.njit(cache=True, nogil=True)
def most_of_limb(values: Array, of_joint: Indices) -> Array:
    """Values (J,) of joints, each replaced by its limb's largest."""
    most = np.full(of_joint.max() + 2, -np.inf)
    for j in range(len(values)):
        most[of_joint[j]] = max(most[of_joint[j]], values[j])
    return most[of_joint]


def area_left(joints: Array, seen: Seen, sighted: Sighted) -> Array:
    """Square metres (J,) of observed surface near joints (J, 3) that no part of the body explains."""
    points, each = unexplained_points(seen.posed, sighted.subject, sighted.stretch)
    squares = np.sum((points - joints[:, None]) ** 2, axis=-1)
    left: Array = np.exp(-0.5 * squares / AROUND**2).sum(axis=1) * each
    return left


@lru_cache(maxsize=16)
def limbs_of(model: BodyModel) -> Limbs:
    """The limbs of a body's joints, -1 for what nothing moves; what slides is the trunk and no limb."""
    groups, group_of = find_limbs(model), np.full(len(model.kinds) + 1, -1)  # the last for what nothing moves
    for k, dofs in enumerate(groups):
        group_of[dofs] = k
    of_joint = group_of[model.link_dofs[model.joint_links]]
    of_limb = np.array([bool(np.all(model.kinds[g] == ROTATION)) for g in groups])[of_joint] & (of_joint >= 0)
    at_rest = joint_positions(model, np.zeros((1, len(model.kinds))))[0]
    begins = model.points[[dofs[0] for dofs in groups]][of_joint]
    lever = np.where(of_limb, np.linalg.norm(at_rest - begins, axis=1), 0.0)
    return Limbs(of_joint, lever, (group_of[:-1] == of_joint[:, None]) & of_limb[:, None])
