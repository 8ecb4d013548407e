"""The people that a run of several has found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from coordinator.results.summary import SUMMARY_FILE

FOUND = "found"  # in the summary of all: one entry for each who was found


def people_in(run: Path) -> list[Path]:
    """The folders of the people who were found in a run; none where it is of a single person."""
    try:
        summary = msgspec.json.decode((run / SUMMARY_FILE).read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError):
        return []
    return [run / each["folder"] for each in summary.get(FOUND, [])]
