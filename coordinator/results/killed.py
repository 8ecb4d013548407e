"""What a killed live run left is finished before it is read."""

from __future__ import annotations

from pathlib import Path

from gepf.coordinator.files import LIVE_FILE
from gepf.coordinator.results.summary import PERSON


def finish_killed(folder: Path) -> None:
    """If a live run was killed in this folder, which may be that of a person, write its files and say so.

    InputError if the run goes on, or nothing can be written.
    """
    run = folder.parent if folder.name.startswith(PERSON) and not (folder / LIVE_FILE).exists() else folder
    if (run / LIVE_FILE).exists():
        from gepf.coordinator.results.live_recorder import finish_live  # loads the compiler, which is slow

        finish_live(run)
