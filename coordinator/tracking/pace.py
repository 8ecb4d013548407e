"""The farther frames are apart in time, the farther a body moves, and the more time there is to follow it."""

from __future__ import annotations

import msgspec

from common.settings import RefineSettings
from coordinator.filters.sighting import USUAL_INTERVAL

MOST = 3.0  # times the iterations


def pace_iterations(settings: RefineSettings, interval: float) -> RefineSettings:
    """As many iterations a second as at 30 frames a second, up to three times as many a frame."""
    factor = min(max(interval / USUAL_INTERVAL, 1.0), MOST)
    return msgspec.structs.replace(settings, icp_iterations=round(settings.icp_iterations * factor))
