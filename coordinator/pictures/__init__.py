"""Pictures by which a person can judge a run."""

from __future__ import annotations

from coordinator.pictures.run import draw_run

__all__ = ["draw_run"]
