"""How a body has moved between two frames as its encoders report: the mean of the filter's motion prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import difference

Array = NDArray[np.float64]


class States(Protocol):
    """Values of joints over time."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the joints (K,)."""
        ...

    def at(self, time_s: float) -> Array:
        """Values (K,), NaN where they are not known."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class KnownMotion:
    """Steps between frames from joint states. Only their change counts: an encoder's offset does no harm."""

    states: States

    def step(self, model: BodyModel, pose: Array, since_s: float | None, until_s: float) -> Array | None:
        """The step (D,) of relative motion between two times, NaN where it is not known; None for no idea.

        `pose` (D,) gives what is not known of a ball's turn; a ball counts only where all of it is known.
        """
        if since_s is None:
            return None
        before, after = pose.copy(), pose.copy()
        known = np.zeros(len(pose), dtype=bool)
        first, last = self.states.at(since_s), self.states.at(until_s)
        for name, one, other in zip(self.states.names, first, last, strict=True):
            if name in model.dof_names and np.isfinite(one + other):
                j = model.dof(name)
                before[j], after[j], known[j] = one, other, True
        for ball in model.balls:
            known[ball : ball + 3] = known[ball : ball + 3].all()
        step = difference(model, before[None], after[None])[0]
        return np.where(known, step, np.nan) if known.any() else None
