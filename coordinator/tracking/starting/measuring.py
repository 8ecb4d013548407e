"""A person's stature and girth from many frames: one frame alone is off by a few centimetres.

Each frame is asked how likely it is with the body a little larger, smaller, thicker and thinner, the pose
refined anew. Slope and curvature of the log likelihood in the logarithm of a measure say which measure the
frame asks for; what is known is the mean over frames. Whoever stands upright shows stature: a frame counts
less the more the body is bent, and the worse it is explained. How curved a frame's likelihood is says little
of how right it is, so it does not count. Hypotheses keep their poses when the body changes. The sizes that
frames are asked about stay the same until the person turns out to be of quite another one.
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
GUESS = np.array([0.1, 0.35])  # frames that the first guess of stature counts as, and the usual girth
INTERVAL = 0.095  # seconds between frames that are asked, at the least
RARER = 12  # frames after which they are twice as far apart, again and again
CHANGES = 3  # frames after which the body changes
FAR = 0.02  # share by which the size may be off those that frames are asked about
LEAST_CURVATURE = np.array([300.0, 30.0])  # of a frame
LARGEST_STEP = 0.06  # that a frame may ask for, as a share
UPRIGHT = (0.97, 0.99)  # head to ankle, as a share of a straight body's: bent, and straight
BENT = 0.01  # weight of a bent body's frame
EXPLAINED = -10.0  # log likelihood from which on a frame counts in full


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What one frame says: slope and curvature (K,) of its log likelihood in log stature and log girth.

    Stature comes first; where it is alone (K = 1), nothing was asked about girth.
    """

    slope: Array
    curvature: Array
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What is known of log stature (m) and log girth: sums over frames, and their weights, (2,) each."""

    total: Array
    weight: Array
    about: tuple[float, float]  # stature and girth about which frames are asked
    frames: int = 0
    time_s: float = -np.inf

    @classmethod
    def guessed(cls, stature: float, girth: float) -> Self:
        """Before any frame was asked: about this stature, and about the usual girth, whatever was found."""
        return cls(GUESS * np.log([stature, USUAL_GIRTH]), GUESS, (stature, girth))

    @property
    def logarithms(self) -> Array:
        """Log stature (m) and log girth (2,)."""
        mean: Array = self.total / self.weight
        return mean

    @property
    def size(self) -> tuple[float, float]:
        """Stature in metres, and girth."""
        stature, girth = np.exp(self.logarithms).tolist()
        return stature, girth

    @property
    def is_far(self) -> bool:
        """Whether the size is quite another one than those that frames are asked about."""
        off: Array = np.abs(self.logarithms - np.log(self.about))
        return bool(np.any(off > FAR))

    @property
    def ripe(self) -> bool:
        """Whether it is time to change the body."""
        return self.frames > 0 and self.frames % CHANGES == 0

    @property
    def asks_girth(self) -> bool:
        """Whether the next frame is asked about girth, too: every other one."""
        return self.frames % 2 == 0

    def asks(self, time_s: float) -> bool:
        """Whether the frame of this time is to be asked: ever more rarely."""
        return not 0.0 <= time_s - self.time_s < INTERVAL * 2.0 ** (self.frames // RARER)

    def passed(self, time_s: float) -> Self:
        """After a frame that was asked and gave no answer."""
        return replace(self, time_s=time_s)

    def after(self, shown: Shown, time_s: float) -> Self:
        """With what a frame says that was asked."""
        asked = slice(len(shown.slope))
        curvature = np.maximum(shown.curvature, LEAST_CURVATURE[asked])
        step = np.clip(shown.slope / curvature, -LARGEST_STEP, LARGEST_STEP)
        total, weight = self.total.copy(), self.weight.copy()
        total[asked] += shown.weight * (np.log(self.about)[asked] + step)
        weight[asked] += shown.weight
        known = replace(self, total=total, weight=weight, frames=self.frames + 1, time_s=time_s)
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
