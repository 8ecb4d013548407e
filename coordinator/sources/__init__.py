"""Depth sequences in: one file a format, one protocol for all, found by looking at the path."""

from __future__ import annotations

import stat
from pathlib import Path

from common.errors import InputError
from coordinator.sources.recorded_folder import RecordedFolder
from coordinator.sources.source import Source
from coordinator.sources.utd_mhad import UtdMhadFile

__all__ = ["Source", "open_source"]


def open_source(path: Path | str) -> Source:
    """The sequence at `path`: a folder as Open3D's recorders write it, or a UTD-MHAD `.mat` file.

    Reads what is needed to know the camera and the frames' numbers, no frame of a folder. Raises
    InputError where there is no sequence, or where its description is damaged.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(
            f"no such file or folder: {path}; give a recorded folder or a UTD-MHAD .mat file"
        ) from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give another path") from error
    if stat.S_ISDIR(mode):
        return RecordedFolder(path)
    if path.suffix.lower() == ".mat":
        return UtdMhadFile(path)
    raise InputError(
        f"{path} is no depth sequence that is known here; "
        "give a folder with depth/000000.png and camera_intrinsic.json, or a UTD-MHAD .mat file"
    )
