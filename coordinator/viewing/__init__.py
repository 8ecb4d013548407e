"""A run on a time line, in the rerun viewer."""

from __future__ import annotations

from coordinator.viewing.show import save_run, serve_run

__all__ = ["save_run", "serve_run"]
