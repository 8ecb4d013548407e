"""A person's measures from a few tracked frames: those whose body explains the depth best.

Coordinate descent: one measure after the other is made a little smaller and larger, the body of each is
refined from the tracked poses in all frames, and the likeliest is kept, if it is so in more than a few of
them; each sweep takes smaller steps. A measure leaves what stature implies only as far as people differ, and
at a price.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.settings import RefineSettings
from coordinator.bodies.human.measures import FRACTIONS_OF_STATURE, Measures
from coordinator.tracking.refiner import Refiner

Array = NDArray[np.float64]

MEASURES = (
    "stature", "girth", "trunk", "thigh", "shank", "upper_arm", "forearm", "shoulder_width", "hip_width",
)  # fmt: skip
FARTHEST = 0.15  # from what stature implies
USUAL_DEVIATION = 0.05  # of people's measures from what stature implies
ROUNDS = 8  # of ICP for each candidate
SURE = 2.0  # standard errors of the gain over the frames that a change needs


@dataclass(frozen=True, slots=True)
class Sweeps:
    """Which measures are fitted, one after the other, and by which part of each: one step for each sweep."""

    measures: tuple[str, ...] = MEASURES
    steps: tuple[float, ...] = (0.05, 0.025)


WHOLE_FIT = Sweeps()


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A frame, and the pose (D,) that the body has in it."""

    subject: SubjectFrame
    pose: Array


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Measures, and how well their body explains the frames (F,)."""

    measures: Measures
    poses: list[Array]  # (D,) each
    log_likelihood: Array  # (F,)
    residual: Array  # (F,) metres

    @property
    def score(self) -> float:
        """Mean log likelihood of a frame, less what unusual measures cost."""
        return float(self.log_likelihood.mean()) - rarity(self.measures)


class Fitter:
    """Fits measures to frames.

    Args:
        frames: Of one person.
        build: The tracked body of measures; all have the same degrees of freedom.
        refiner: Has poses refined.
        settings: How to refine them.
        sweeps: What is changed, and by how much.
    """

    def __init__(
        self,
        frames: Sequence[Posed],
        build: Callable[[Measures], BodyModel],
        refiner: Refiner,
        settings: RefineSettings,
        sweeps: Sweeps = WHOLE_FIT,
    ) -> None:
        self._sweeps = sweeps
        self._frames = frames
        self._build = cache(build)
        self._refiner = refiner
        self._settings = msgspec.structs.replace(settings, icp_iterations=ROUNDS)

    def fit(
        self, measures: Measures, advance: Callable[[int, int], None] = lambda *_: None
    ) -> tuple[Fit, Fit]:
        """How well the given measures fit, and the best that was found from there."""
        (before,) = self._assess([measures], [frame.pose for frame in self._frames])
        names, steps = self._sweeps.measures, self._sweeps.steps
        best, total = before, len(steps) * len(names)
        for sweep, step in enumerate(steps):
            for n, name in enumerate(names):
                candidates = [change(best.measures, name, factor) for factor in (1.0, 1 - step, 1 + step)]
                best = better(*self._assess(candidates, best.poses))
                advance(sweep * len(names) + n + 1, total)
        return before, best

    def _assess(self, candidates: Sequence[Measures], poses: Sequence[Array]) -> list[Fit]:
        """Candidates after their descent from the same poses, frame by frame."""
        models = [self._build(measures) for measures in candidates]
        refined = []
        for frame, pose in zip(self._frames, poses, strict=True):
            self._refiner.publish(frame.subject)
            refined.append(
                [self._refiner.submit(model, pose[None], self._settings).result() for model in models]
            )
        return [
            Fit(
                measures,
                [of_frame[k].poses[0] for of_frame in refined],
                np.array([of_frame[k].log_likelihood[0] for of_frame in refined]),
                np.array([of_frame[k].residual[0] for of_frame in refined]),
            )
            for k, measures in enumerate(candidates)
        ]


def better(stays: Fit, *others: Fit) -> Fit:
    """The likeliest of the others, if its gain in the frames is beyond chance; else what there was."""
    best = max(others, key=lambda fit: fit.score)
    gain = best.log_likelihood - stays.log_likelihood
    doubt = float(gain.std()) / math.sqrt(len(gain))
    return best if best.score - stays.score > SURE * doubt else stays


def change(measures: Measures, name: str, factor: float) -> Measures:
    """Measures with one of them changed as far as people differ; stature takes all lengths with it."""
    if name == "stature":
        lengths = {part: getattr(measures, part) * factor for part in FRACTIONS_OF_STATURE}
        return replace(measures, stature=measures.stature * factor, **lengths)
    usual = FRACTIONS_OF_STATURE.get(name, 1.0 / measures.stature) * measures.stature
    spread = 2.0 * FARTHEST if name == "girth" else FARTHEST
    value = float(np.clip(getattr(measures, name) * factor, usual * (1 - spread), usual * (1 + spread)))
    return replace(measures, **{name: value})


def rarity(measures: Measures) -> float:
    """Negative log density of the lengths, given stature; 0 for those that stature implies."""
    values = asdict(measures)
    ratios = [values[part] / (share * measures.stature) for part, share in FRACTIONS_OF_STATURE.items()]
    return 0.5 * float(np.sum((np.log(ratios) / USUAL_DEVIATION) ** 2)) / len(ratios)
