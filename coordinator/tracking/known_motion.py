"""The motion of a body between two frames by its encoders: the mean of the filter's motion prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from common.arrays import Array
from common.body import BodyModel
from common.kinematics import difference
from coordinator.sources.joint_states import JointStates

if TYPE_CHECKING:  # it loads the types of ROS
    from coordinator.sources.ros2_input import JointTopic


@dataclass(frozen=True, slots=True, eq=False)
class KnownMotion:
    """Steps between frames from joint states. Only changes are used, so offsets of encoders do not matter."""

    states: JointStates | JointTopic

    def step(self, model: BodyModel, pose: Array, since_s: float | None, until_s: float) -> Array | None:
        """The relative motion (D,) between two times, NaN if unknown; None if all of it is unknown.

        `pose` (D,) gives missing angles of a spherical joint. Its motion is known only if all its angles are.
        """
        if since_s is None:
            return None
        before, after = pose.copy(), pose.copy()
        known = np.zeros(len(pose), dtype=bool)
        first, last = self.states.at(since_s), self.states.at(until_s)
        for name, one, other in zip(
            self.states.names, first, last, strict=False
        ):  # no names before live states
            if name in model.dof_names and np.isfinite(one + other):
                j = model.dof(name)
                before[j], after[j], known[j] = one, other, True
        for ball in model.balls:
            known[ball : ball + 3] = known[ball : ball + 3].all()
        step = difference(model, before[None], after[None])[0]
        return np.where(known, step, np.nan) if known.any() else None
