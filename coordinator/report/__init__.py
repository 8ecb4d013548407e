"""The report: one page about a run."""

from __future__ import annotations

from coordinator.report.page import write_report

__all__ = ["write_report"]
