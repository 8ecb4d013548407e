"""Calibrates a rig by a person who moves: each camera tracks the person alone, and the joints are aligned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from common.arrays import Array
from common.errors import InputError
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.calibration.skeletons import Alignment, align, motion_of
from coordinator.sources.source import Source
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.tracker import Tracker

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
        followed = Tracker(refiner, settings, bodies).follow(source)
        motions.append(motion_of([tracked.estimate for (tracked,) in followed]))
    found = {names[0]: CameraPlace(np.eye(4), 0.0, np.zeros(7))}
    for name, motion in zip(names[1:], motions[1:], strict=True):
        aligned = require(name, names[0], align(motions[0], motion))
        found[name] = CameraPlace(aligned.placed, aligned.offset_s, aligned.deviations)
    return {name: judge(name, each) for name, each in found.items()}


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
