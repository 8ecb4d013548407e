"""A person's stature and girth from many frames: one frame alone is off by a few centimetres.

Each frame is asked how likely it is with the body a little larger, smaller, thicker and thinner, the pose
refined anew. Slope and curvature of the log likelihood in the logarithm of a measure are what the frame says
of it; they add up, with what is usual before. Whoever stands upright shows stature: a frame counts less the
more the body is bent, and the worse it is explained. Hypotheses keep their poses when the body changes,
which is after 2, 4, 8, ... frames, until enough was seen. The sizes that frames are asked about stay the same
until the person turns out to be of quite another one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions

Array = NDArray[np.float64]

USUAL_GIRTH = 1.07
DEVIATIONS = (0.1, 0.1)  # of stature about the first guess, and of girth about the usual: shares
ENOUGH = 12.0  # frames of an upright body
LONGEST = 60  # frames that are asked at the most
INTERVAL = 0.095  # seconds between them, at the least
FAR = 0.02  # share by which the size may be off those that frames are asked about
LEAST_CURVATURE = np.array([300.0, 30.0])  # of a frame
LARGEST_STEP = 0.06  # that a frame may ask for, as a share
UPRIGHT = (0.90, 0.96)  # head to ankle, as a share of a straight body's: bent, and straight
BENT = 0.05  # weight of a bent body's frame
EXPLAINED = -10.0  # log likelihood from which on a frame counts in full


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What one frame says: slope and curvature (2,) of its log likelihood in log stature and log girth."""

    slope: Array
    curvature: Array
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What is known of log stature (m) and log girth (2,): information, and information times estimate."""

    information: Array
    pull: Array
    about: tuple[float, float]  # stature and girth about which frames are asked
    frames: int = 0
    weight: float = 0.0
    time_s: float = -np.inf

    @classmethod
    def guessed(cls, stature: float, girth: float) -> Self:
        """Before any frame was asked: about this stature, and about the usual girth, whatever was found."""
        information = 1.0 / np.square(DEVIATIONS)
        return cls(information, information * np.log([stature, USUAL_GIRTH]), (stature, girth))

    @property
    def size(self) -> tuple[float, float]:
        """Stature in metres, and girth."""
        stature, girth = np.exp(self.pull / self.information).tolist()
        return stature, girth

    @property
    def is_far(self) -> bool:
        """Whether the size is quite another one than those that frames are asked about."""
        off: Array = np.abs(self.pull / self.information - np.log(self.about))
        return bool(np.any(off > FAR))

    @property
    def ripe(self) -> bool:
        """Whether it is time to change the body: after 2, 4, 8, ... frames, and at the end."""
        doubled = self.frames >= 2 and self.frames & (self.frames - 1) == 0
        return doubled or self.done

    @property
    def done(self) -> bool:
        """Whether enough was seen."""
        return self.weight >= ENOUGH or self.frames >= LONGEST

    def asks(self, time_s: float) -> bool:
        """Whether the frame of this time is to be asked."""
        return not self.done and not 0.0 <= time_s - self.time_s < INTERVAL

    def passed(self, time_s: float) -> Self:
        """After a frame that was asked and gave no answer."""
        return replace(self, time_s=time_s)

    def after(self, shown: Shown, time_s: float) -> Self:
        """With what a frame says that was asked."""
        curvature = np.maximum(shown.curvature, LEAST_CURVATURE)
        step = np.clip(shown.slope / curvature, -LARGEST_STEP, LARGEST_STEP)
        information = shown.weight * curvature
        known = replace(
            self,
            information=self.information + information,
            pull=self.pull + information * (np.log(self.about) + step),
            frames=self.frames + 1,
            weight=self.weight + shown.weight,
            time_s=time_s,
        )
        return replace(known, about=known.size) if known.is_far else known


def uprightness(model: BodyModel, pose: Array) -> float:
    """How far the head is from the farther ankle in a pose (D,), as a share of what it is at rest."""
    head = model.joint_names.index("head")
    ankles = [model.joint_names.index(f"{side}_ankle") for side in ("left", "right")]
    posed = joint_positions(model, np.stack([np.zeros_like(pose), pose]))
    rest, now = np.linalg.norm(posed[:, ankles] - posed[:, head, None], axis=-1).max(axis=-1)
    return float(now / rest)


def weigh_frame(upright: float, log_likelihood: float) -> float:
    """What a frame counts: 1 for one that shows an upright body and is well explained."""
    bent, straight = UPRIGHT
    share = float(np.clip((upright - bent) / (straight - bent), BENT, 1.0))
    return float(share * min(1.0, EXPLAINED / min(log_likelihood, EXPLAINED)))
