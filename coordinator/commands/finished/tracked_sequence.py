"""The sequence of a run, where it is now."""

from __future__ import annotations

import logging
from pathlib import Path

from coordinator.results.configuration import GIVEN, PATH
from coordinator.results.summary import read_summary
from coordinator.sources import Source, open_source
from coordinator.sources.camera import CameraOptions

logger = logging.getLogger(__name__)


def find_sequence(run: Path, given: Path | None) -> Source | None:
    """The sequence that was tracked: as given, else where it was; None, with a warning, if it is gone."""
    if given is not None:
        return open_source(given)
    summary = read_summary(run)
    recorded, camera = summary.get(PATH), summary.get(GIVEN) or {}
    if recorded is not None and Path(recorded).exists():
        lens = camera.get("lens")
        return open_source(
            Path(recorded), CameraOptions(tuple(lens) if lens else None, camera.get("depth_scale"))
        )
    logger.warning("the sequence of this run is not where it was; --sequence SEQ shows its depth as well")
    return None
