"""Short rendered sequences of a person who raises the left arm, and a tracker that knows the person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics, inverse, moved
from gepf.common.frame import Frame, SubjectFrame, SubjectView, View
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.bodies.human.dofs import HUMAN_DOFS
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.shape_space import Size, shape_space
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.settings import Settings, preset
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.tracking.candidate_refinement import Search
from gepf.coordinator.tracking.estimate import Certainty, Estimate
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.pose_candidates import Detection
from gepf.coordinator.tracking.state import PersonState, Start
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner


class OnePerson(Tracker):
    """`Tracker` for one person."""

    @property
    def person(self) -> PersonState:
        """The person's state for the next frame."""
        return self.state.people[0]

    @property
    def start(self) -> Start:
        """The body, and where tracking began."""
        return self.person.start

    @property
    def model(self) -> BodyModel:
        """The body that is tracked."""
        return self.person.body

    def track(self, frame: Frame) -> Estimate:  # type: ignore[override]
        """The estimate of the next frame."""
        return super().track(frame).people[0].estimate


CAMERA = Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)
FRAMES = 4
STANDING = {
    "root_tx": 0.1,
    "root_ty": 0.1,
    "root_tz": 2.7,
    "r_shoulder_abduct": 0.2,
    "l_shoulder_abduct": 0.2,
}
SITTING = {
    "root_tx": -0.1, "root_tz": 2.4, "r_shoulder_abduct": 0.25, "l_shoulder_abduct": 0.25,
    **{f"{side}_{joint}_flexion": 1.5 for side in "rl" for joint in ("hip", "knee")},
}  # fmt: skip
RAISING = {"l_elbow_flexion": 0.25, "l_shoulder_flexion": 0.15}  # by frame
SETTINGS = msgspec.structs.replace(
    preset("default"), points=2000, filter=msgspec.structs.replace(preset("default").filter, particles=6)
)


class Shown(NamedTuple):
    """Frames of a person, and where the joints are (F, J, 3)."""

    frames: list[Frame]
    joints: Array


@cache
def shown(posture: str, stature: float = 1.82) -> Shown:
    """A person who raises the left arm, standing or sitting."""
    model = human(stature)
    first = STANDING if posture == "standing" else SITTING
    return show(model, np.array([name_pose(model, raised(first, n)) for n in range(FRAMES)]))


def raised(
    posture: Mapping[str, float], number: int, rates: Mapping[str, float] = RAISING
) -> dict[str, float]:
    """The posture, with the arm as high as in a frame."""
    return {**posture, **{name: rate * number for name, rate in rates.items()}}


def show(model: BodyModel, poses: Array) -> Shown:
    """A body in poses (F, D)."""
    frames = [frame_of(n, picture) for n, picture in enumerate(rendered(model, poses))]
    return Shown(frames, joint_positions(model, poses))


def rendered(
    model: BodyModel, poses: Array, camera: Intrinsics = CAMERA, placed: Array | None = None
) -> list[Array]:
    """Depth images (H, W) of a body in poses (N, D), metres, of a camera at T_rig_camera (4, 4)."""
    vertices = pose_vertices(model, poses)
    vertices = vertices if placed is None else moved(vertices, inverse(placed))
    with DepthRenderer(camera) as renderer:
        return [renderer.depth(each, model.triangles).astype(np.float64) for each in vertices]


def subject_of(frame: Frame, points: int) -> SubjectFrame:
    """A frame of which all that is measured is the subject's."""
    subject = isolate(frame, points)
    assert subject is not None
    return subject


def frame_of(
    number: int, depth_m: NDArray[np.floating], camera: Intrinsics = CAMERA, scale: float = 1000.0
) -> Frame:
    """A frame of one camera in millimetres, or in other units of depth."""
    units = np.rint(depth_m * scale).astype(np.uint16)
    return Frame.of(View(number, number / 30.0, units, scale, camera))


def changed(frame: Frame, **changes: Any) -> Frame:
    """A frame of one camera with other values of its image."""
    (view,) = frame.views
    return Frame.of(replace(view, **changes))


def alone(view: SubjectView) -> SubjectFrame:
    """A subject that one camera shows."""
    return SubjectFrame(view.image.number, view.image.time_s, (view,))


def empty(number: int) -> Frame:
    """A frame that shows nothing."""
    return frame_of(number, np.zeros((CAMERA.height, CAMERA.width)))


def people_of(size: Size | None) -> Bodies:
    """People of this size, or of any, with the paper's degrees of freedom."""
    space = shape_space()
    freedom = {"space": space} if size is None else {"size": size}
    return Bodies(PEOPLE, space.person, DEFAULT_ACTIVE, DEFAULT_ACTIVE, HUMAN_DOFS, **freedom)


@cache
def known() -> Bodies:
    """The person who is shown, whose measures are known."""
    return people_of(Size(1.82, 1.0))


@cache
def people() -> Bodies:
    """People of any size, as the command line makes them, of the paper's degrees of freedom."""
    return people_of(None)


def tracker(settings: Settings = SETTINGS, start: dict[str, float] = STANDING) -> OnePerson:
    """A tracker of the known person, from a given start."""
    return OnePerson(DirectRefiner(), settings, known(), start=start)


def complete(search: Search[Detection]) -> Detection:
    """Run a search to its end."""
    while True:
        try:
            next(search)
        except StopIteration as end:
            return cast("Detection", end.value)


def as_bytes(estimate: Estimate) -> list[bytes]:
    """All values of an estimate except times."""
    apart = ("stage_seconds", "certainty", "seen_by", "faults", "keypoints")
    names = [field.name for field in fields(Estimate) if field.name not in apart]
    sure = [getattr(estimate.certainty, field.name) for field in fields(Certainty)]
    own = (getattr(estimate, name) for name in names)
    by_camera = (*estimate.seen_by.values(), *estimate.keypoints.values())
    return [np.asarray(value).tobytes() for value in (*own, *sure, *by_camera)]
