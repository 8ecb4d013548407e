"""Calibrates a rig: track each camera alone, align the joints, then refine on the surface with the body.

The refinement alternates: the body is tracked by all cameras, then all are placed by the tracked surface, and
the rig is moved back so that the first one stays. The first round also measures how thick the person is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.calibration.skeletons import Alignment, align, motion_of
from coordinator.calibration.surface import Sight, place, surfaces_of
from coordinator.sources.source import Source
from coordinator.tracking.estimate import UNKNOWN
from coordinator.tracking.observation import camera_points
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Tracked
from coordinator.tracking.tracker import Tracker

Array = NDArray[np.float64]

SETTLED = np.repeat([np.radians(0.05), 0.001, 0.0005], (3, 3, 1))  # a smaller step ends the rounds
POINTS = 300  # of a camera in a frame
MISFIT_M = 0.09  # largest mean residual of joints of the same person
LARGEST = np.repeat([np.radians(1.0), 0.02, 0.008], (3, 3, 1))  # deviations; with larger ones it is a guess
SURE = np.zeros(7)
WHAT = ("rotation", "position", "clock")
ADVICE = ("walk about in all that {} sees", "walk closer to {} and turn about", "wave before {}")


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """Where a camera is, and how sure that is.

    placed: T_rig_camera (4, 4). deviations: (7,) of the rotation about the rig's axes and of the position at
    the person, radians and metres; and of the clock, seconds; None if they are not known. advice: what would
    make the largest of them smaller.
    """

    placed: Array
    offset_s: float
    deviations: Array | None = None
    advice: str = ""


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
    names, motions = list(sources), []
    for name, source in sources.items():
        report(f"tracking {name} alone")
        motions.append(motion_of([each.estimate for each in follow(source, refiner, settings, bodies)]))
    aligned = [Alignment(np.eye(4), 0.0, 0.0)]
    for name, each in zip(names[1:], motions[1:], strict=True):
        aligned.append(require(name, names[0], align(motions[0], each)))
    placed = np.array([each.placed for each in aligned])
    offsets = np.array([each.offset_s for each in aligned])
    for n in range(4):
        report(f"tracking with all cameras, round {n + 1}")
        views = [
            source.changed(camera=name, T_rig_camera=place, offset_s=float(offset))
            for (name, source), place, offset in zip(sources.items(), placed, offsets, strict=True)
        ]
        tracked = follow(views[0].changed(others=tuple(views[1:])), refiner, settings, bodies)
        found = place(list(sights_of(tracked, names)), placed, shape_known=n > 0)
        if found is None:
            raise InputError(
                f"{' and '.join(names)} do not show enough of the person at the same time; record again"
            )
        bodies = bodies.thicker(found.outside) if n == 0 else bodies
        placed, offsets, deviations = found.placed, offsets + found.steps[:, 6], found.deviations
        if np.all(np.abs(found.steps) < SETTLED):
            break
    places = zip(placed, offsets.tolist(), deviations, strict=True)
    return {name: judge(name, CameraPlace(*place)) for name, place in zip(names, places, strict=True)}


def follow(source: Source, refiner: Refiner, settings: Settings, bodies: Bodies) -> list[Tracked]:
    """Track one person through a source."""
    return [tracked for (tracked,) in Tracker(refiner, settings, bodies).follow(source)]


def sights_of(tracked: Sequence[Tracked], names: Sequence[str]) -> Iterable[Sight]:
    """What each camera saw in each frame that shows the person, with the surface."""
    model = tracked[-1].state.start.model
    times = np.array([each.estimate.time_s for each in tracked])
    known = [each.estimate.status not in UNKNOWN for each in tracked]
    surfaces = surfaces_of(times, known, model, np.array([each.estimate.pose for each in tracked]))
    for each, surface in zip(tracked, surfaces, strict=True):
        if each.subject is None or surface is None:
            continue
        for view in each.subject.views:
            points = camera_points(view, max(1, len(view.picked) // POINTS))
            yield Sight(names.index(view.frame.camera), view.delay_s, points, surface)


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


def judge(name: str, found: CameraPlace) -> CameraPlace:
    """A place, with what would make its largest deviation smaller; InputError if it is not determined."""
    spread = SURE if found.deviations is None else found.deviations
    worst = int(np.argmax(spread / LARGEST))
    advice = ADVICE[worst // 3].format(name)
    if not spread[worst] <= LARGEST[worst]:
        raise InputError(f"the {WHAT[worst // 3]} of {name} is not determined; {advice}, and record again")
    return replace(found, advice=advice)
