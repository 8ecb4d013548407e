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

from gepf.common.packages import needs

if TYPE_CHECKING:
    from gepf.common.body import BodyModel as BodyModel
    from gepf.common.camera import Intrinsics as Intrinsics
    from gepf.common.errors import GepfError as GepfError
    from gepf.common.errors import InputError as InputError
    from gepf.common.frame import Frame as Frame
    from gepf.common.frame import View as View
    from gepf.coordinator.bodies.human.measures import Measures as Measures
    from gepf.coordinator.filters.methods import settings_for as settings_for
    from gepf.coordinator.pool.options import Pool as Pool
    from gepf.coordinator.security.access import TlsFiles as TlsFiles
    from gepf.coordinator.settings import Settings as Settings
    from gepf.coordinator.settings import preset as preset
    from gepf.coordinator.sources import ArraySource as ArraySource
    from gepf.coordinator.sources import Source as Source
    from gepf.coordinator.sources import open_source as open_source
    from gepf.geometry import to_open3d as to_open3d
    from gepf.live_source import LiveSource as LiveSource
    from gepf.live_source import live as live
    from gepf.named import Estimate as Estimate
    from gepf.run import Run as Run
    from gepf.run import load as load
    from gepf.tracker import PeopleTracker as PeopleTracker
    from gepf.tracker import Tracker as Tracker
    from gepf.tracker import track as track

_PUBLIC = {
    "gepf.common.body": ("BodyModel",),
    "gepf.common.camera": ("Intrinsics",),
    "gepf.common.errors": ("GepfError", "InputError"),
    "gepf.common.frame": ("Frame", "View"),
    "gepf.coordinator.settings": ("Settings", "preset"),
    "gepf.coordinator.bodies.human.measures": ("Measures",),
    "gepf.coordinator.filters.methods": ("settings_for",),
    "gepf.coordinator.pool.options": ("Pool",),
    "gepf.coordinator.security.access": ("TlsFiles",),
    "gepf.coordinator.sources": ("ArraySource", "Source", "open_source"),
    "gepf.geometry": ("to_open3d",),
    "gepf.live_source": ("LiveSource", "live"),
    "gepf.named": ("Estimate",),
    "gepf.run": ("Run", "load"),
    "gepf.tracker": ("PeopleTracker", "Tracker", "track"),
}
_HOMES = {name: module for module, names in _PUBLIC.items() for name in names}
"""Public name -> its module, which is loaded when the name is first used."""

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Load public names when they are used: numpy, compiler and figures take seconds to load.

    If a package is missing, MissingPackage names the extra to install: the base install is only a worker.
    """
    if name == "__version__":
        from importlib import metadata

        return metadata.version("gepf")
    if name not in _HOMES:
        raise AttributeError(f"module 'gepf' has no attribute '{name}'")
    with needs("coordinator", f"gepf.{name}"):
        value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    """The public names."""
    return __all__
