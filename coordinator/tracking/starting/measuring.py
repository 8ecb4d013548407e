"""A person's stature and girth from many frames: one frame alone is off by a few centimetres.

Each frame is asked how likely it is with the body a little larger, smaller, thicker and thinner, the pose
refined anew. Slope and curvature of the log likelihood in the logarithm of a measure say which measure the
frame asks for; what is known is the mean over frames. Whoever stands upright shows stature: a frame counts
less the more the body is bent, and the worse it is explained. How curved a frame's likelihood is says little
of how right it is, so it does not count. Where a frame shows head and soles, how far they are apart says as
much of stature as all other points together: their errors have little in common. Hypotheses keep their poses
when the body changes. The sizes that frames are asked about stay the same until the person turns out to be of
quite another one.
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
LEAST_CHANGE = np.array([0.0015, 0.005])  # of stature and girth, as a share: a new body has to be laid out
FAR = 0.02  # share by which the size may be off those that frames are asked about
KEPT = 0.2  # share of the weight of what frames said that were asked about quite another stature
EXTREME = 0.01  # share by which a size may be off the limits and still be at them
LEAST_CURVATURE = np.array([300.0, 30.0])  # of a frame
LENGTH_SHARE = 0.4  # of a frame's word on stature that its length has, where it is seen
LARGEST_STEP = 0.06  # that a frame may ask for, as a share
UPRIGHT = (0.97, 0.99)  # head to ankle, as a share of a straight body's: bent, and straight
BENT = 0.01  # weight of a bent body's frame
RAISED = 0.2  # weight of a frame in which a hand is above its shoulder
EXPLAINED = -10.0  # log likelihood from which on a frame counts in full
SMALLEST, LARGEST = (1.2, 0.6), (2.2, 1.7)
"""Stature in metres, and girth, beyond which nobody is sought: from a child of seven years (WHO's growth
reference: 1.22 m) to 6 deviations above men's mean (ANSUR II: 1.76 and 0.07 m); girths of waists are within
0.7 to 1.4 of the mean in all but one of a thousand (the same), and clothes come on top."""
LIMITS = np.log([SMALLEST, LARGEST])


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What one frame says: slope and curvature (K,) of its log likelihood in log stature and log girth.

    Stature comes first; where it is alone (K = 1), nothing was asked about girth. `by_length` is the log
    stature (m) that the length from head to sole asks for; None where it is not seen. `bent` is whether the
    body was, so that it shows next to nothing of its stature.
    """

    slope: Array
    curvature: Array
    weight: float
    by_length: float | None = None
    bent: bool = False

    def asks_for(self, about: tuple[float, float]) -> Array:
        """Log stature (m) and log girth (K,), not far from those that were asked about."""
        step = self.slope / np.maximum(self.curvature, LEAST_CURVATURE[: len(self.slope)])
        asked = np.log(about)[: len(step)]
        size: Array = asked + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        if self.by_length is not None:
            length = np.clip(self.by_length - asked[0], -LARGEST_STEP, LARGEST_STEP) + asked[0]
            size[0] += LENGTH_SHARE * (length - size[0])
        return size


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What is known of log stature (m) and log girth: sums over frames, and their weights, (2,) each."""

    total: Array
    weight: Array
    about: tuple[float, float]  # stature and girth about which frames are asked
    frames: int = 0  # that were asked
    bent: int = 0  # of them, in which the body was
    time_s: float = -np.inf

    @classmethod
    def guessed(cls, stature: float, girth: float, *, bent: bool = False) -> Self:
        """Before any frame was asked: about this stature, and about the usual girth, whatever was found.

        The stature of who was found `bent` counts no more than what a bent frame says.
        """
        weight = np.array([BENT, GUESS[1]]) if bent else GUESS
        return cls(weight * np.log([stature, USUAL_GIRTH]), weight, (stature, girth))

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
    def is_extreme(self) -> bool:
        """Whether it is the smallest or largest that is sought: frames may ask for more."""
        apart = np.minimum(self.logarithms - LIMITS[0], LIMITS[1] - self.logarithms)
        return bool(np.any(apart < EXTREME))

    @property
    def is_far(self) -> bool:
        """Whether the size is quite another one than those that frames are asked about."""
        return bool(np.any(self._off > FAR))

    @property
    def _off(self) -> Array:
        off: Array = np.abs(self.logarithms - np.log(self.about))
        return off

    @property
    def ripe(self) -> bool:
        """Whether it is time to change the body."""
        return self.frames > 0 and self.frames % CHANGES == 0

    @property
    def asks_girth(self) -> bool:
        """Whether the next frame is asked about girth, too: every other one."""
        return self.frames % 2 == 0

    def differs(self, stature: float, girth: float) -> bool:
        """Whether it is noticeably another size than this one, in metres and as a factor."""
        return bool(np.any(np.abs(self.logarithms - np.log([stature, girth])) > LEAST_CHANGE))

    def asks(self, time_s: float, *, bent: bool = False) -> bool:
        """Whether the frame of this time is to be asked: ever more rarely, of upright and bent ones each.

        Bent ones say next to nothing, and are asked while no upright ones are to be had.
        """
        upright = self.frames - self.bent
        if bent and upright >= CHANGES:
            return False
        asked = self.bent if bent else upright
        return not 0.0 <= time_s - self.time_s < INTERVAL * 2.0 ** (asked // RARER)

    def passed(self, time_s: float) -> Self:
        """After a frame that was asked and gave no answer."""
        return replace(self, time_s=time_s)

    def after(self, shown: Shown, time_s: float) -> Self:
        """With what a frame says that was asked."""
        asked = slice(len(shown.slope))
        total, weight, added = self.total.copy(), self.weight.copy(), self._adds(shown)
        total[asked] += added * np.clip(shown.asks_for(self.about), *LIMITS[:, asked])
        weight[asked] += added
        bent = self.bent + shown.bent
        known = replace(self, total=total, weight=weight, frames=self.frames + 1, bent=bent, time_s=time_s)
        return known.asking_anew() if known.is_far else known

    def _adds(self, shown: Shown) -> float:
        """What a frame adds: of bent ones the n-th 2 / (n (n + 1)) of the first, all of them twice as much.

        For half of the variance of what a bent frame says is an error that all of them have in common.
        """
        n = self.bent + 1
        return shown.weight * 2.0 / (n * (n + 1)) if shown.bent else shown.weight

    def asking_anew(self) -> Self:
        """The same size, asked about from now on; what was said about quite another stature counts less."""
        kept = np.array([KEPT if self._off[0] > FAR else 1.0, 1.0])
        return replace(self, total=kept * self.total, weight=kept * self.weight, about=self.size)


def uprightness(model: BodyModel, pose: Array) -> float:
    """How far the head is from the farther ankle in a pose (D,), as a share of what it is at rest."""
    head, *ankles = ends_of(model)
    posed = joint_positions(model, np.stack([np.zeros_like(pose), pose]))
    rest, now = np.linalg.norm(posed[:, ankles] - posed[:, head, None], axis=-1).max(axis=-1)
    return float(now / rest)


def ends_of(model: BodyModel) -> list[int]:
    """Joints between which a person's stature lies: the head and both ankles."""
    return [model.joint_names.index(name) for name in ("head", "left_ankle", "right_ankle")]


def is_bent(model: BodyModel, pose: Array) -> bool:
    """Whether a body in a pose (D,) shows next to nothing of its stature."""
    return uprightness(model, pose) <= UPRIGHT[0]


def has_raised(model: BodyModel, pose: Array) -> bool:
    """Whether a hand is above its shoulder, along the trunk: shoulders rise with arms, by no joint here."""
    joints = dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))
    trunk = joints["neck"] - joints["pelvis"]
    over = [joints[f"{side}_wrist"] - joints[f"{side}_shoulder"] for side in ("left", "right")]
    return any(offset @ trunk > 0.0 for offset in over)


def weigh_frame(upright: float, log_likelihood: float) -> float:
    """What a frame counts: 1 for one that shows an upright body and is well explained."""
    bent, straight = UPRIGHT
    share = float(np.clip((upright - bent) / (straight - bent), BENT, 1.0))
    return float(share * min(1.0, EXPLAINED / min(log_likelihood, EXPLAINED)))
