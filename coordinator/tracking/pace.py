"""The farther frames are apart in time, the farther a body moves, and the more time there is to follow it."""

from __future__ import annotations

import msgspec

from common.settings import RefineSettings, Settings
from coordinator.filters.belief import USUAL_INTERVAL

MOST = 3.0  # times the iterations at a pace of 1, and its square at a pace of 2
LIVE_PACE = 1.0


def pace_iterations(settings: RefineSettings, interval: float, pace: float, most: int) -> RefineSettings:
    """As many iterations a second as at 30 frames a second at a pace of 1, nearly twice as many at 2.

    A frame of 0.1 s gets three and five times those of a usual one, and one of 0.17 s three and nine times,
    but `most` at the most, unless the settings ask for more.
    """
    factor = 1.0 + pace * max(interval / USUAL_INTERVAL - 1.0, 0.0)
    usual = settings.icp_iterations
    paced = min(round(usual * min(factor, MOST**pace)), most)
    return msgspec.structs.replace(settings, icp_iterations=max(usual, paced))


def keep_up(settings: Settings) -> Settings:
    """Settings for live input, where a frame that takes long makes the next one come later."""
    return msgspec.structs.replace(settings, pace_iterations=min(settings.pace_iterations, LIVE_PACE))
