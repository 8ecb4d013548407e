"""The human template: a clothed person of any size with all joint angles of MPEG-4.

model = human(1.80)
body = activate(model, DEFAULT_ACTIVE, np.zeros(len(model.dof_names)))
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gepf.common.body import BodyModel
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, shape_space

DEFAULT_ACTIVE: tuple[str, ...] = (
    "root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz",
    "l_shoulder_flexion", "l_shoulder_abduct", "l_shoulder_twisting", "l_elbow_flexion",
    "r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion",
    "l_hip_flexion", "l_hip_abduct", "l_hip_twisting", "l_knee_flexion", "l_ankle_flexion",
    "r_hip_flexion", "r_hip_abduct", "r_hip_twisting", "r_knee_flexion", "r_ankle_flexion",
)  # fmt: skip
"""The 24 degrees of freedom of the paper's section 5."""


def human(stature_m: float = REFERENCE_STATURE, girth: float = 1.0, **measures: float) -> BodyModel:
    """A person of this stature (metres); `girth` scales the width, `measures` are age and lengths (metres).

    All 186 degrees of freedom, root first. Raises InputError for implausible measures.
    """
    return human_of(Measures.of(stature_m, girth, **measures))


@lru_cache(maxsize=4)
def human_of(measures: Measures) -> BodyModel:
    """A person with these measures, with all degrees of freedom; the last few are cached."""
    return shape_space().person(
        measures.stature, measures.girth, age=measures.age, lengths=np.array(measures.lengths)
    )
