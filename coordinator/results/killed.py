"""Finishes a live run that was killed, before its results are read."""

from __future__ import annotations

from pathlib import Path

from gepf.coordinator.files import LIVE_FILE
from gepf.coordinator.results.summary import PERSON


def finish_killed(folder: Path) -> None:
    """If a folder holds a live run that was killed, write the files of the run and tell the user.

    The folder may also be that of one person of the run. InputError if the run is still going on, or if
    nothing can be written.
    """
    run = folder.parent if folder.name.startswith(PERSON) and not (folder / LIVE_FILE).exists() else folder
    if (run / LIVE_FILE).exists():
        from gepf.coordinator.results.live_recorder import finish_live  # loads the compiler, which is slow

        finish_live(run)
