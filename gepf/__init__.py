"""Track a body through depth images from Python: create a Tracker, feed it depth, get hypotheses.

with Tracker(workers=2) as tracker:
    for frame in open_source("recording/"):
        estimate = tracker.track(frame)

run = load("run/")
print(run.angle("right_elbow_flexion", degrees=True))

What is not named here is internal. Faults of the input raise InputError, all others another GepfError.
"""

from __future__ import annotations

from common.body import BodyModel
from common.camera import Intrinsics
from common.errors import GepfError, InputError
from common.frame import DepthFrame
from common.settings import Settings, preset
from coordinator.bodies.human.measures import Measures
from coordinator.filters.methods import settings_for
from coordinator.pool.options import Pool
from coordinator.security.access import TlsFiles
from coordinator.sources import ArraySource, Source, open_source
from gepf.live_source import LiveSource, live
from gepf.named import Estimate
from gepf.people import PeopleTracker
from gepf.run import Run, load
from gepf.tracker import Tracker

__all__ = [
    "ArraySource",
    "BodyModel",
    "DepthFrame",
    "Estimate",
    "GepfError",
    "InputError",
    "Intrinsics",
    "LiveSource",
    "Measures",
    "PeopleTracker",
    "Pool",
    "Run",
    "Settings",
    "Source",
    "TlsFiles",
    "Tracker",
    "live",
    "load",
    "open_source",
    "preset",
    "settings_for",
]


def __dir__() -> list[str]:
    """What is public, and nothing else."""
    return __all__
