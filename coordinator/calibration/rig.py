"""Calibrates a rig: track each camera alone, align the joints, then refine on the surface with the body.

The refinement alternates: the body is tracked by all cameras, then each camera, also the first, is placed by
the tracked surface, and the rig is moved back so that the first one stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import inverse
from common.errors import InputError
from common.frame import SubjectFrame
from common.kinematics import pose_vertices
from common.settings import RefineSettings, Settings
from coordinator.bodies.tracked import Bodies
from coordinator.calibration.skeletons import Alignment, align, motion_of
from coordinator.calibration.surface import Placement, Sight, Surface, place, surfaces_of
from coordinator.sources.source import Source
from coordinator.tracking.estimate import UNKNOWN
from coordinator.tracking.observation import camera_points
from coordinator.tracking.refiner import Pending, Refiner
from coordinator.tracking.reporting import Tracked
from coordinator.tracking.tracker import Tracker

Array = NDArray[np.float64]

ROUNDS = 6  # of tracking and placing
SETTLED = (np.radians(0.05), 0.001, 0.0005)  # radians, metres, seconds: a smaller step ends the rounds
MODEL_DEVIATIONS = np.repeat([np.radians(0.32), 0.004, 0.003], (3, 3, 1))
"""Errors that are alike in all frames, as of the surface: radians, metres, seconds (`dance`, `turn`)."""
SURE = np.zeros(7)
POINTS = 300  # of a camera in a frame
MISFIT_M = 0.09  # largest mean residual of joints of the same person
LARGEST_DEVIATIONS = (
    np.radians(1.0),
    0.02,
    0.008,
)  # radians, metres, seconds: with larger ones it is a guess


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """Where a camera is, and how sure that is.

    placed: T_rig_camera (4, 4). deviations: (7,) of the rotation about the rig's axes and of the position at
    the person, radians and metres; and of the clock, seconds; None if they are not known.
    """

    placed: Array
    offset_s: float
    deviations: Array | None = None


class Watching:
    """A refiner that notes what shows the person in each frame."""

    def __init__(self, refiner: Refiner) -> None:
        self._refiner = refiner
        self.subjects = dict[int, SubjectFrame]()

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame."""
        self._refiner.publish(subject)

    def submit(
        self,
        subject: SubjectFrame,
        model: BodyModel,
        poses: Array,
        settings: RefineSettings,
        *,
        covariance: bool = False,
        spare: bool = False,
        velocity: Array | None = None,
    ) -> Pending:
        """Start to refine poses (N, D)."""
        if not spare:
            self.subjects[subject.frame.number] = subject
        return self._refiner.submit(
            subject, model, poses, settings, covariance=covariance, spare=spare, velocity=velocity
        )


def calibrate(
    sources: Mapping[str, Source],
    refiner: Refiner,
    settings: Settings,
    bodies: Bodies,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, CameraPlace]:
    """The places of cameras by name, in the frame and the time of the first one.

    Raises InputError if the recordings do not determine them.
    """
    (first, source), *others = ((name, each.changed(camera=name)) for name, each in sources.items())
    motions = {}
    for name, each in ((first, source), *others):
        report(f"tracking {name} alone")
        tracked = follow(each, refiner, settings, bodies)
        motions[name] = motion_of([one.estimate for one in tracked])
    aligned = {name: require(name, first, align(motions[first], motions[name])) for name, _ in others}
    places = {name: CameraPlace(a.placed, a.offset_s, SURE) for name, a in aligned.items()}
    for n in range(ROUNDS):
        report(f"tracking with all cameras, round {n + 1}")
        rig = source.changed(others=tuple(put(each, places[name]) for name, each in others))
        watching = Watching(refiner)
        tracked = follow(rig, watching, settings, bodies)
        steps = place_all(tracked, watching.subjects, {first: CameraPlace(np.eye(4), 0.0, SURE), **places})
        back, own = inverse(steps[first].apply(np.eye(4))), steps[first]
        for name, found in places.items():
            step = steps[name]
            drawn = np.diag(step.covariance + own.covariance)
            deviations = np.sqrt(drawn + MODEL_DEVIATIONS**2)
            offset = found.offset_s + float(step.step[6] - own.step[6])
            places[name] = CameraPlace(back @ step.apply(found.placed), offset, deviations)
        if all(is_settled(step, own) for step in steps.values()):
            break
    for name, found in places.items():
        refuse_guess(name, first, found)
    return {first: CameraPlace(np.eye(4), 0.0, SURE), **places}


def follow(source: Source, refiner: Refiner, settings: Settings, bodies: Bodies) -> list[Tracked]:
    """Track one person through a source."""
    return [tracked for (tracked,) in Tracker(refiner, settings, bodies).follow(source)]


def put(source: Source, found: CameraPlace) -> Source:
    """The sequence of a camera at its place."""
    return source.changed(T_rig_camera=found.placed, offset_s=found.offset_s)


def place_all(
    tracked: Sequence[Tracked], subjects: Mapping[int, SubjectFrame], places: Mapping[str, CameraPlace]
) -> dict[str, Placement]:
    """Place each camera by the surface that was tracked with all of them."""
    times = np.array([each.estimate.time_s for each in tracked])
    triangles = tracked[-1].state.start.model.triangles
    surfaces = surfaces_of(times, [vertices_of(each) for each in tracked], triangles)
    found = {}
    for name, camera in places.items():
        sights = list(sights_of(name, tracked, subjects, surfaces))
        step = place(sights, camera.placed)
        if step is None:
            raise InputError(
                f"{name} shows too little of the person at times when the others do; record again"
            )
        found[name] = step
    return found


def vertices_of(tracked: Tracked) -> Array | None:
    """The surface (V, 3) of a tracked body; None if its pose is unknown."""
    if tracked.estimate.status in UNKNOWN:
        return None
    vertices: Array = pose_vertices(tracked.state.start.model, tracked.estimate.pose[None])[0]
    return vertices


def sights_of(
    name: str,
    tracked: Sequence[Tracked],
    subjects: Mapping[int, SubjectFrame],
    surfaces: Sequence[Surface | None],
) -> Iterable[Sight]:
    """What a camera saw in each frame that shows the person, with the surface."""
    for each, surface in zip(tracked, surfaces, strict=True):
        subject = subjects.get(each.estimate.frame)
        for view in () if subject is None or surface is None else subject.views:
            if view.frame.camera == name and surface is not None:
                points = camera_points(view, max(1, len(view.picked) // POINTS))
                yield Sight(each.estimate.time_s + view.delay_s, points, surface)


def is_settled(step: Placement, own: Placement) -> bool:
    """Whether a camera's step from that of the first is so small that another round would change nothing."""
    rest = np.abs(step.step - own.step)
    sizes = rest[:3].max(), rest[3:6].max(), rest[6]
    return bool(np.all(np.array(sizes) < SETTLED))


def require(name: str, first: str, found: Alignment | None) -> Alignment:
    """The alignment; InputError if there is none, or if the cameras do not show the same motion."""
    if found is None:
        raise InputError(
            f"{name} and {first} do not show the person at the same time; record at least a second of it"
        )
    if found.residual_m > MISFIT_M:
        raise InputError(
            f"{name} does not show the motion of {first}: joints are {100 * found.residual_m:.0f} cm apart "
            "at best; record one person who moves in front of both"
        )
    return found


def refuse_guess(name: str, first: str, found: CameraPlace) -> None:
    """InputError if a place is not determined, with what would help."""
    spread = SURE if found.deviations is None else found.deviations
    sizes = spread[:3].max(), spread[3:6].max(), spread[6]
    remedies = ("walk about, also towards the cameras", "walk closer to it", "move faster, as in waving")
    what = ("rotation", "position", "clock")
    for size, most, which, remedy in zip(sizes, LARGEST_DEVIATIONS, what, remedies, strict=True):
        if not size <= most:
            raise InputError(
                f"the {which} of {name} relative to {first} is not determined; {remedy}, and record again"
            )
