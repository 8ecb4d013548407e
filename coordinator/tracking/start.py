"""Where tracking begins: a body, its size, and the pose that it has in the first frame that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import Bodies, pose_by_name
from coordinator.tracking.observing.sensor_noise import SensorNoise

Array = NDArray[np.float64]

QUARTER = 0.5 * np.pi
USUAL_MEASURES = (REFERENCE_STATURE, 1.0)  # of a body whose measures are not known


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A body and its pose (D,) in the first frame that shows it; `values` by name, of what does not move too.

    Until it is `found`, the body is only what its degrees of freedom and joints are named after: the pose is
    not a number, nor are stature and girth. `way_up` is by how much the picture has to be turned for the
    body to be upright, radians, in quarters. `noise` is what was measured of the camera's in that frame; zero
    where it was not.
    """

    model: BodyModel
    pose: Array
    stature: float
    girth: float
    values: Mapping[str, float] = field(default_factory=dict)
    noise: SensorNoise = field(default_factory=SensorNoise)
    found: bool = True
    way_up: float = 0.0

    @property
    def held(self) -> dict[str, float]:
        """Values other than zero of degrees of freedom that do not move."""
        return {name: v for name, v in self.values.items() if v and name not in self.model.dof_names}


def no_start(bodies: Bodies) -> Start:
    """What there is before anybody is found."""
    model, pose = bodies.tracked(*(bodies.measures or USUAL_MEASURES), {})
    return Start(model, np.full_like(pose, np.nan), np.nan, np.nan, found=False)


def given_start(values: Mapping[str, float], bodies: Bodies) -> Start:
    """The start at a pose given by name, of the measures that are known."""
    stature, girth = bodies.measures or USUAL_MEASURES
    model, pose = bodies.tracked(stature, girth, values)
    return Start(model, pose, stature, girth, values=dict(values))


def detected_start(
    searched: BodyModel, pose: Array, size: tuple[float, float], bodies: Bodies, noise: SensorNoise
) -> Start:
    """The start at a pose (D,) of the body that was searched for, of this stature and girth."""
    values = pose_by_name(searched, pose)
    model, tracked = bodies.tracked(*size, values)
    return Start(model, tracked, *size, values, noise, way_up=way_up(model, tracked))


def way_up(model: BodyModel, pose: Array) -> float:
    """By how many quarter turns, in radians, the picture is turned so that a pose (D,) is upright in it."""
    if not {"head", "pelvis"} <= set(model.joint_names):
        return 0.0
    joints = joint_positions(model, pose[None])[0]
    across, down, _ = joints[model.joint_names.index("head")] - joints[model.joint_names.index("pelvis")]
    quarters = round(float(-np.arctan2(across, -down)) / QUARTER) % 4
    return quarters * QUARTER
