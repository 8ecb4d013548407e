"""A person's stature and girth from many frames: one frame alone is off by a few centimetres.

Each frame is asked how likely it is with the body a little larger, smaller, thicker and thinner, the pose
refined anew. Slope and curvature of the log likelihood in the logarithm of a measure say which measure the
frame asks for; what is known is the mean over frames, by how much each tells (`uprightness`). How curved a
frame's likelihood is says little of how right it is, so it does not count. Where a frame shows head and
soles, two fifths of its word on stature are how far they are apart: its errors have little in common with
those of all other points. Hypotheses keep their poses when the body changes. Frames are asked about the size
that is known, and their words are drawn to it: what was said about another one counts less.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.starting.uprightness import BENT

Array = NDArray[np.float64]

USUAL = (1.69, 1.07)  # stature, men's and women's mean (ANSUR II), and girth
PRIOR = np.array([BENT, 0.35])  # frames that these count as: who sits shows as little as people differ by
GUESS = 0.1  # frames that the first guess of stature counts as
INTERVAL = 0.095  # seconds between frames that are asked, at the least
RARER = 12  # frames after which they are twice as far apart, again and again, and asked about one size
CHANGES = 3  # frames after which the body changes
LEAST_CHANGE = np.array([0.0015, 0.005])  # of stature and girth, as a share: a new body has to be laid out
FAR = np.array([0.01, 0.03])  # by which a body's stature and girth are so far off that it changes at once
BELIEVED = 0.01  # share by which a stature may be off the one that a frame was asked about to count half
EXTREME = 0.01  # share by which a size may be off the limits and still be at them
LEAST_CURVATURE = np.array([300.0, 30.0])  # of a frame
LENGTH_SHARE = 0.4  # of a frame's word on stature that its length has, where it is seen
LARGEST_STEP = 0.06  # that a frame may ask for, as a share
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
    """What is known of log stature (m) and log girth: sums over frames, and their weights, (2,) each.

    Those of bent frames are kept apart: half of the variance of what they say of stature is an error that
    they have in common, so that n of them count as 2 n / (n + 1).
    """

    total: Array
    weight: Array
    about: tuple[float, float]  # stature and girth about which frames are asked
    bent_total: Array = field(default_factory=lambda: np.zeros(2))
    bent_weight: Array = field(default_factory=lambda: np.zeros(2))
    frames: int = 0  # that were asked
    bent: int = 0  # of them, in which the body was
    time_s: float = -np.inf

    @classmethod
    def guessed(cls, stature: float, girth: float, *, bent: bool = False) -> Self:
        """Before any frame was asked: about this stature and usual people's, and about their girth.

        The stature of who was found `bent` counts no more than what a bent frame says.
        """
        guess = np.array([BENT if bent else GUESS, 0.0])
        total = PRIOR * np.log(USUAL) + guess * np.log([stature, girth])
        return cls(total, PRIOR + guess, (stature, girth))

    @property
    def logarithms(self) -> Array:
        """Log stature (m) and log girth (2,)."""
        share = np.array([2.0 / (self.bent + 1.0), 1.0])
        weight = self.weight + share * self.bent_weight
        mean: Array = (self.total + share * self.bent_total) / weight
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
    def asks_girth(self) -> bool:
        """Whether the next frame is asked about girth, too: every other one."""
        return self.frames % 2 == 0

    def changes(self, stature: float, girth: float) -> bool:
        """Whether it is time to change a body of this stature in metres and this girth."""
        ripe = self.frames % CHANGES == 0
        return self.frames > 0 and self.is_off((stature, girth), LEAST_CHANGE if ripe else FAR)

    def is_off(self, measures: tuple[float, float], shares: Array) -> bool:
        """Whether one of these measures is by such a share (2,) another one than is known."""
        return bool(np.any(np.abs(self.logarithms - np.log(measures)) > shares))

    def asks(self, time_s: float, *, bent: bool = False) -> bool:
        """Whether the frame of this time is to be asked: ever more rarely, of upright and bent ones each.

        Bent ones say next to nothing, and are asked while no upright ones are to be had.
        """
        upright = self.frames - self.bent
        if bent and upright >= CHANGES:
            return False
        asked = self.bent if bent else upright
        return not 0.0 <= time_s - self.time_s < INTERVAL * 2.0 ** (asked // RARER)

    def may_ask(self, time_s: float) -> bool:
        """Whether there is a way to stand in which the frame of this time is to be asked."""
        return self.asks(time_s) or self.asks(time_s, bent=True)

    def passed(self, time_s: float) -> Self:
        """After a frame that was asked and gave no answer."""
        return replace(self, time_s=time_s)

    def after(self, shown: Shown, time_s: float) -> Self:
        """With what a frame says that was asked.

        A bent one changes no size that is asked about: asked about less, it says less again. After the first
        `RARER` upright ones only a size that is far off changes it: noisy words would lead each other away.
        """
        asked = slice(len(shown.slope))
        said, weight = np.zeros(2), np.zeros(2)
        said[asked] = shown.weight * np.clip(shown.asks_for(self.about), *LIMITS[:, asked])
        weight[asked] = shown.weight
        known = replace(self._adding(said, weight, bent=shown.bent), frames=self.frames + 1, time_s=time_s)
        young = known.frames - known.bent <= RARER
        astray = known.changes(*known.about) if young else known.is_off(known.about, 2.0 * FAR)
        return known.asking_anew() if astray and not shown.bent else known

    def _adding(self, said: Array, weight: Array, *, bent: bool) -> Self:
        if not bent:
            return replace(self, total=self.total + said, weight=self.weight + weight)
        total, weight = self.bent_total + said, self.bent_weight + weight
        return replace(self, bent_total=total, bent_weight=weight, bent=self.bent + 1)

    def asking_anew(self) -> Self:
        """The same size, asked about from now on.

        What was said about another stature counts less the farther it was off: a frame's word is drawn to
        the one that it is asked about.
        """
        off = self.logarithms[0] - np.log(self.about[0])
        kept = np.array([1.0 / (1.0 + (off / BELIEVED) ** 2), 1.0])
        return replace(
            self,
            total=kept * self.total,
            weight=kept * self.weight,
            bent_total=kept * self.bent_total,
            bent_weight=kept * self.bent_weight,
            about=self.size,
        )
