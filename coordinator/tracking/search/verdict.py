"""Whether a pose explains a frame, and what speaks against it: doubt in place of convincing nonsense."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.settings import FAR_NOISIER, RefineSettings

Array = NDArray[np.float64]

RESIDUAL = 0.03  # metres, mean distance of observed points that can be believed, the camera's noise aside
MISFIT = 0.028  # metres, root of the mean cost, which also counts what of the model is seen where nothing is
FEWEST = 150  # pixels that can show a body

SPANS = (0.35, 1.6)  # statures that a whole person is long, from end to end of what is seen
FLAT = 0.85  # share of a person's points in one plane that is a board's
THICK = 0.03  # metres, of a plane
PLANES = 40  # that are tried
HEAD_DOWN = -0.2  # metres that a head is above the pelvis of who stands on it
BELOW, ABOVE = -0.25, 0.6  # metres of the lowest joint above the floor

UNEXPLAINED = "the body does not explain what is seen"
Doubt = tuple[float, str]
"""By how much it adds to the strain, as a factor, and in words."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """How far a pose strains belief: up to 1 it stands. `why` is the doubt that weighs most, in words."""

    strain: float
    why: str = ""

    @property
    def stands(self) -> bool:
        """Whether the pose can be believed."""
        return self.strain <= 1.0


def weigh(log_likelihood: float, residual: float, settings: RefineSettings) -> Verdict:
    """What likelihood and residual (metres) say, for settings that know the camera's noise."""
    misfit = 0.0
    if settings.noise_depth <= FAR_NOISIER * settings.noise_lateral:
        cost = np.sqrt(max(0.0, -2.0 * log_likelihood)) * settings.likelihood_scale
        misfit = float(cost / np.hypot(MISFIT, settings.noise_lateral))
    strain = max(float(residual) / (RESIDUAL + settings.noise_depth), misfit)
    if not strain <= 1.0:
        return Verdict(strain if strain > 1.0 else np.inf, UNEXPLAINED)
    return Verdict(strain)


def add_doubts(verdict: Verdict, doubts: list[Doubt]) -> Verdict:
    """A verdict with more that speaks against the pose."""
    strain = verdict.strain * float(np.prod([factor for factor, _ in doubts]))
    gravest = max(doubts, key=lambda doubt: doubt[0], default=(1.0, ""))
    return Verdict(strain, verdict.why or gravest[1])


def doubt_span(points: Array, stature: float) -> list[Doubt]:
    """Points (P, 3) that spread much less or more than a person: most often a wrong scale of the depth."""
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    span = float(np.max(high - low))
    if SPANS[0] * stature <= span <= SPANS[1] * stature:
        return []
    size = f"{span:.1f} m" if span >= 1.0 else f"{100 * span:.0f} cm"
    return [(10.0, f"what is seen is {size} from end to end, which is no person: is depth_scale right?")]


def doubt_flat(points: Array) -> list[Doubt]:
    """Points (P, 3) of which nearly all lie in one plane: a board, a curtain, a stand."""
    some = points[:: -(-len(points) // 1_000)]
    rng = np.random.default_rng(0)
    best = 0.0
    for corner in rng.integers(len(some), size=(PLANES, 3)):
        a, b, c = some[corner]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length > 1e-6:
            best = max(best, float(np.mean(np.abs((some - a) @ normal) < THICK * length)))
    if best < FLAT:
        return []
    return [(2.0, f"{100 * best:.0f} % of what is seen lies in one plane: a thing, no person")]


def doubt_size(*, extreme: bool, stature: float) -> list[Doubt]:
    """A body that is the smallest or the largest that was tried."""
    if not extreme:
        return []
    return [(1.15, f"the body came out {stature:.2f} m tall, which is as far as sizes are tried")]


def doubt_place(rises: float, lowest: float) -> list[Doubt]:
    """A body whose head is below its pelvis, or that is below or far above the floor.

    Args:
        rises: How far the head is above the pelvis, metres.
        lowest: Height of the lowest joint above the floor, metres.
    """
    doubts: list[Doubt] = []
    if rises < HEAD_DOWN:
        doubts.append((1.25, "the body is upside down: is the camera? say so with --rotate"))
    if lowest < BELOW:
        doubts.append((1.3, f"the body reaches {-100 * lowest:.0f} cm below the floor"))
    if lowest > ABOVE:
        doubts.append((1.3, f"the body floats {100 * lowest:.0f} cm above the floor"))
    return doubts
