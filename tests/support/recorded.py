"""A person who raises a forearm, and how the tracker follows: the same through every input."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import DepthFrame
from common.kinematics import pose_vertices
from common.settings import preset
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import Bodies, name_pose
from coordinator.sources.utd_mhad import KINECT
from coordinator.synthesis.rendering import DepthRenderer
from gepf.direct import DirectRefiner
from tests.support.one_person import OnePerson
from tests.support.recordings import (
    Depth,
)

Array = NDArray[np.float64]

START = {"root_ty": 0.1, "root_tz": 2.6, "r_shoulder_abduct": 0.3, "l_shoulder_abduct": 0.3}
RAISING = {"r_elbow_flexion": 0.12, "root_tx": 0.01}  # by frame
FRAMES = 3


@cache
def bodies() -> Bodies:
    """The person of the sequence, made once."""
    one = cache(human)
    return Bodies(one, DEFAULT_ACTIVE, DEFAULT_ACTIVE, measures=(1.75, 1.0))


def full_body() -> BodyModel:
    """The person with all degrees of freedom."""
    return bodies().full(1.75, 1.0)


@cache
def recorded() -> Depth:
    """Frames (F, H, W) of a person who raises a forearm, in whole millimetres."""
    model = full_body()
    poses = np.array(
        [name_pose(model, START | {name: rate * n for name, rate in RAISING.items()}) for n in range(FRAMES)]
    )
    with DepthRenderer(KINECT) as renderer:
        images = [renderer.depth(v, model.triangles) for v in pose_vertices(model, poses)]
    millimetres: NDArray[np.float64] = np.rint(np.array(images) * 1000.0)
    return millimetres.astype(np.uint16)


def poses_of(frames: Iterable[DepthFrame]) -> Array:
    """Poses (F, D) of the tracker on these frames."""
    settings = preset("default")
    one = msgspec.structs.replace(settings.filter, particles=1)
    settings = msgspec.structs.replace(settings, method="gradient", points=1500, filter=one)
    tracker = OnePerson(DirectRefiner(), settings, bodies(), START)
    return np.array([tracker.track(frame).pose for frame in frames])
