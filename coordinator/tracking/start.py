"""Where tracking begins: a person facing the camera, placed and scaled from the first frame.

A few ways to stand and sit, statures and girths are tried through the same refinement that tracks; the
likeliest is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import back_project
from common.errors import InputError
from common.frame import SubjectFrame
from common.settings import RefineSettings
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import Bodies, name_pose, pose_by_name
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.sensor_noise import SensorNoise

Array = NDArray[np.float64]

_ARMS = {"r_shoulder_abduct": 0.15, "l_shoulder_abduct": 0.15}
_LEGS = {"r_hip_flexion": 1.45, "l_hip_flexion": 1.45, "r_knee_flexion": 1.45, "l_knee_flexion": 1.45}
POSTURES = (
    # share of the stature that is seen from top to bottom, of it above the pelvis, joint angles
    (1.0, 0.47, _ARMS),
    (0.77, 0.62, _ARMS | _LEGS),
)
STATURES = (1.4, 2.05)  # metres; where less or more is seen, the person is not seen whole
SCALES = (0.94, 0.97, 1.0, 1.03, 1.06)
GIRTHS = (0.9, 1.05, 1.2)
USUAL_MEASURES = (REFERENCE_STATURE, 1.0)  # of a body whose measures are not known
SEARCHED_GIRTH = 1.05
ROUNDS = 12  # of ICP for each candidate
BODY_RADIUS = 0.1  # metres from the skin that is seen to the pelvis


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A body and its pose (D,) in the first frame; `values` by name, of what does not move too.

    `noise` is what was measured of the camera's in that frame; zero where it was not.
    """

    model: BodyModel
    pose: Array
    stature: float
    girth: float
    log_likelihood: float = -np.inf
    values: Mapping[str, float] = field(default_factory=dict)
    noise: SensorNoise = field(default_factory=SensorNoise)

    @property
    def held(self) -> dict[str, float]:
        """Values other than zero of degrees of freedom that do not move."""
        return {name: v for name, v in self.values.items() if v and name not in self.model.dof_names}


def require_start(given: Mapping[str, float] | None, bodies: Bodies) -> None:
    """InputError where a start is neither given nor can be found."""
    if given is None and not bodies.finds_start:
        raise InputError(
            "only a person's start is found automatically; give --init FILE with the body's pose in the "
            "first frame, {degree of freedom: radians or metres}"
        )


def given_start(values: Mapping[str, float], bodies: Bodies) -> Start:
    """The start at a pose given by name, of the measures that are known."""
    stature, girth = bodies.measures or USUAL_MEASURES
    model, pose = bodies.tracked(stature, girth, values)
    return Start(model, pose, stature, girth, values=dict(values))


def find_start(subject: SubjectFrame, bodies: Bodies, refiner: Refiner, settings: RefineSettings) -> Start:
    """The likeliest of postures, then of statures and girths."""
    thorough = msgspec.structs.replace(settings, icp_iterations=ROUNDS)

    def best(candidates: list[Start]) -> Start:
        return max((descend(c, refiner, thorough) for c in candidates), key=lambda c: c.log_likelihood)

    found = best(postures(observed_points(subject), bodies))
    if bodies.measures is None:
        found = best([resize(found, bodies, found.stature * s, girth) for girth in GIRTHS for s in SCALES])
    values = pose_by_name(found.model, found.pose)
    model, pose = bodies.tracked(found.stature, found.girth, values)
    return replace(found, model=model, pose=pose, values=values)


def observed_points(subject: SubjectFrame) -> Array:
    """The subject's points (P, 3) in the camera frame, metres."""
    depth = subject.frame.metres()
    points: Array = back_project(depth, subject.frame.intrinsics)[depth > 0]
    return points


def postures(points: Array, bodies: Bodies) -> list[Start]:
    """Candidates that reach from the top to the bottom of the observed points."""
    top, bottom = np.percentile(points[:, 1], [0.2, 99.8])
    middle = np.median(points, axis=0)
    candidates = []
    for share, above, angles in POSTURES:
        stature = float(np.clip((bottom - top) / share, *STATURES))
        girth = SEARCHED_GIRTH
        if bodies.measures is not None:
            stature, girth = bodies.measures
        pelvis = {
            "root_tx": float(middle[0]),
            "root_ty": float(top + above * share * stature),
            "root_tz": float(middle[2] + BODY_RADIUS),
        }
        model = bodies.for_start(stature, girth)
        candidates.append(Start(model, name_pose(model, pelvis | angles), stature, girth))
    return candidates


def resize(start: Start, bodies: Bodies, stature: float, girth: float) -> Start:
    """The same pose on a body of other measures."""
    return replace(start, model=bodies.for_start(stature, girth), stature=stature, girth=girth)


def descend(start: Start, refiner: Refiner, settings: RefineSettings) -> Start:
    """A candidate after its descent, with its likelihood."""
    refined = refiner.submit(start.model, start.pose[None], settings).result()
    return replace(start, pose=refined.poses[0], log_likelihood=float(refined.log_likelihood[0]))
