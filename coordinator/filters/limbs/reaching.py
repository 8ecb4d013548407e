"""Limbs that reach for what nothing explains (preset `default`).

A limb that is lost is seldom hidden: the camera sees it, and no part of the model is near what it sees. So
for each limb many ways to hold it are drawn, and those are kept that come near the points that the rest of
the body leaves unexplained. A limb's own points count as well: what is left behind is no gain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.filters.limbs.layout import LEAST, Limb, LimbView, Ways, draw_ways

Array = NDArray[np.float64]

DRAWS = 96  # ways to hold a limb that are tried first
BEST, VARIANTS = 8, 8  # of these, and how often each is varied
VARIATION = np.radians(20.0)  # one standard deviation


def find_reaches(view: LimbView | None, pose: Array, count: int, rng: np.random.Generator) -> Ways | None:
    """Ways to hold limbs of pose (D,) so that they explain more of the observed points.

    None where no limb could.
    """
    if view is None or view.unexplained < max(3.0, LEAST * len(view.points)):
        return None
    found: list[tuple[Limb, Array, Array]] = []
    for limb in view.layout.limbs:
        held, reached = try_ways(limb, pose, view.points[view.alone[limb.number]], rng)
        found.append((limb, held, np.maximum(0.0, reached - view.own[limb.number])))
    if not any(gain.any() for _, _, gain in found):
        return None
    weights = np.concatenate([gain for _, _, gain in found]) ** 2
    drawn = rng.choice(len(weights), size=count, p=weights / weights.sum())
    limb_at = np.repeat(np.arange(len(found)), [len(gain) for _, _, gain in found])
    angles = [way for _, held, _ in found for way in held]
    return Ways([found[limb_at[k]][0].dofs for k in drawn], [angles[k] for k in drawn])


def try_ways(limb: Limb, pose: Array, points: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Ways (K, d) to hold a limb of pose (D,), and how many of the points (P, 3) each comes near."""
    held = draw_ways(limb, DRAWS, rng)
    variation = VARIATION * rng.standard_normal((BEST * VARIANTS, len(limb.dofs)))
    return limb.try_ways(pose, points, held, variation, BEST)
