"""Track a body through depth images from Python: create a Tracker, give it depth, get estimates.

with Tracker(workers=2) as tracker:
    for frame in open_source("recording/"):
        estimate = tracker.track(frame)

run = track("recording/")  # or load("run/")
print(run.angle("right_elbow_flexion", degrees=True))

Only the names here are public. Wrong input raises InputError; every other error is another GepfError.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from common.body import BodyModel as BodyModel
    from common.camera import Intrinsics as Intrinsics
    from common.errors import GepfError as GepfError
    from common.errors import InputError as InputError
    from common.frame import DepthFrame as DepthFrame
    from common.settings import Settings as Settings
    from common.settings import preset as preset
    from coordinator.bodies.human.measures import Measures as Measures
    from coordinator.filters.methods import settings_for as settings_for
    from coordinator.pool.options import Pool as Pool
    from coordinator.security.access import TlsFiles as TlsFiles
    from coordinator.sources import ArraySource as ArraySource
    from coordinator.sources import Source as Source
    from coordinator.sources import open_source as open_source
    from gepf.live_source import LiveSource as LiveSource
    from gepf.live_source import live as live
    from gepf.named import Estimate as Estimate
    from gepf.run import Run as Run
    from gepf.run import load as load
    from gepf.tracker import PeopleTracker as PeopleTracker
    from gepf.tracker import Tracker as Tracker
    from gepf.tracker import track as track

_PUBLIC = {
    "common.body": ("BodyModel",),
    "common.camera": ("Intrinsics",),
    "common.errors": ("GepfError", "InputError"),
    "common.frame": ("DepthFrame",),
    "common.settings": ("Settings", "preset"),
    "coordinator.bodies.human.measures": ("Measures",),
    "coordinator.filters.methods": ("settings_for",),
    "coordinator.pool.options": ("Pool",),
    "coordinator.security.access": ("TlsFiles",),
    "coordinator.sources": ("ArraySource", "Source", "open_source"),
    "gepf.live_source": ("LiveSource", "live"),
    "gepf.named": ("Estimate",),
    "gepf.run": ("Run", "load"),
    "gepf.tracker": ("PeopleTracker", "Tracker", "track"),
}
_HOMES = {name: module for module, names in _PUBLIC.items() for name in names}
"""Public name -> its module, which is loaded when the name is first used."""

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Load public names when they are used: numpy, compiler and figures take seconds to load."""
    if name not in _HOMES:
        raise AttributeError(f"module 'gepf' has no attribute '{name}'")
    found = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return found


def __dir__() -> list[str]:
    """The public names."""
    return __all__
