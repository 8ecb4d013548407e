"""Finished runs, kept so that a benchmark that was broken off goes on where it was.

A run is found again under all that decides it: its job, the scene, and the code of the packages that track.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import msgspec

from benchmarks.paper.footage import Footage
from benchmarks.paper.runs import Job, Run
from coordinator.files import write_atomically

CODE = ("common", "coordinator", "gepf", "worker")


class Shelf:
    """A folder of runs. Make it when all that tracks is imported."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._code = code()

    def find(self, job: Job, footage: Footage) -> Run | None:
        """The run of a job, if there is one."""
        file = self._file(job, footage)
        return msgspec.json.decode(file.read_bytes(), type=Run) if file.exists() else None

    def keep(self, run: Run, job: Job, footage: Footage) -> None:
        """Put a run where `find` finds it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self._file(job, footage), lambda file: file.write(msgspec.json.encode(run)))

    def _file(self, job: Job, footage: Footage) -> Path:
        decided = hashlib.sha256(self._code)
        decided.update(msgspec.json.encode(job.row.settings(job.seed)))
        decided.update(repr((job.row.noise, job.row.frames, job.row.active, footage.start)).encode())
        decided.update(footage.scene.poses.tobytes())
        return self._folder / f"{job.row.name}-{job.seed}-{decided.hexdigest()[:12]}.json"


def code() -> bytes:
    """Digest of the source of every module of ours that is imported, in order of their names."""
    digest = hashlib.sha256()
    for name in sorted(sys.modules):
        source = getattr(sys.modules[name], "__file__", None)
        if name.partition(".")[0] in CODE and source is not None:
            digest.update(Path(source).read_bytes())
    return digest.digest()
