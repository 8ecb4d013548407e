"""A run's folder: results recorded frame by frame, and its final files written whole at the end."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec

from common.errors import InputError
from common.settings import Settings
from coordinator.files import LOG_FILE, sync_folder, write_atomically, write_json
from coordinator.pool.options import PoolStatistics
from coordinator.results.configuration import RunConfiguration, differences, versions
from coordinator.results.csv_file import write_csv
from coordinator.results.log import (
    Began,
    Entry,
    Opening,
    Record,
    Recorded,
    Resumed,
    append_records,
    assemble,
    read_log,
    up_of,
)
from coordinator.results.summary import SUMMARY_FILE, count_status
from coordinator.results.track import (
    MODEL_FILE,
    TRACK_FILE,
    Track,
    TrackedBody,
    write_track,
    write_tracked_body,
)
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.state import TrackerState

CSV_FILE = "poses.csv"
RESULTS = (TRACK_FILE, SUMMARY_FILE, CSV_FILE)
ELSEWHERE = "choose another --out or delete what is there"


class Recorder:
    """Owns a run's folder from the first frame to the last; a context manager.

    While it is open, `frames.log` grows and is locked against a second run. It goes away when a complete
    run is closed without an error. A folder in which nothing came to be recorded is left as it was found.

    Args:
        folder: Where the run is, or will be.
        configuration: Of the run.
        resume: Go on with what is there; if that is nothing, begin.
        frames: Go on after so many of the frames that are there at the most.

    Raises:
        InputError: The folder is in use, cannot be written, or holds a run that cannot be gone on with.
    """

    def __init__(
        self,
        folder: Path,
        configuration: RunConfiguration,
        *,
        resume: bool = False,
        frames: int | None = None,
    ) -> None:
        self.folder = folder
        self._configuration = configuration
        self._finished = False
        self._made: list[Path] = []
        try:
            self._made = [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            self._log = open_log(folder / LOG_FILE)
            sync_folder(folder)
        except OSError as error:
            _remove_empty(self._made)
            raise InputError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error
        try:
            self.past = claim(folder, configuration, resume=resume, frames=frames)
        except BaseException:
            os.close(self._log)
            raise
        self.frames = len(self.past.estimates) if self.past else 0
        self._start = self.past.state.start if self.past else None
        os.ftruncate(self._log, self.past.end if self.past else 0)
        self._disk = ThreadPoolExecutor(1)
        self._syncing: Future[None] = self._disk.submit(os.fdatasync, self._log)
        if self.past:
            self._write([Resumed()])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the folder free; without a frame, leave no trace of the run."""
        self._disk.shutdown()
        # not by the count alone: an interrupt may come between writing and counting
        log = self.folder / LOG_FILE
        try:
            empty = not self.frames and (not log.exists() or read_log(log) is None)
            if empty or (self._finished and error is None):
                log.unlink(missing_ok=True)
        finally:
            os.close(self._log)
        if empty:
            _remove_empty(self._made)

    def append(
        self, estimate: Estimate, state: TrackerState, statistics: PoolStatistics, seconds: float
    ) -> None:
        """Write one frame's result, and what the tracker knew after it.

        It is there for readers, and survives this process, when this returns. It survives a loss of power
        some milliseconds later, and surely when the next frame is appended or the results are read; so the
        disk works while the workers do. `statistics` and `seconds` are those since this recorder was opened.
        """
        records: list[Record] = [] if self.frames else [Opening(self._configuration)]
        if state.start is not self._start:
            records.append(Began(state.start))
        if self.past:
            statistics, seconds = statistics.after(self.past.statistics), seconds + self.past.seconds
        self._write([*records, Entry(estimate, state.checkpoint, statistics, seconds)])
        self._start = state.start
        self.frames += 1

    def _write(self, records: Sequence[Record]) -> None:
        """Append records when those before them are safe from a loss of power, and begin to make these so."""
        self._syncing.result()
        append_records(self._log, records)
        self._syncing = self._disk.submit(os.fdatasync, self._log)

    def read(self) -> Recorded | None:
        """Everything recorded so far, as it stands in the log; None before the first frame."""
        self._syncing.result()
        return read_log(self.folder / LOG_FILE)

    def discard(self) -> None:
        """Leave no trace of the run at the end, as if no frame had been recorded."""
        for name in (*RESULTS, MODEL_FILE):
            (self.folder / name).unlink(missing_ok=True)
        os.ftruncate(self._log, 0)
        self.frames, self._made = 0, [self.folder]

    def finish(self, recorded: Recorded, summary: Mapping[str, object], *, complete: bool = True) -> Track:
        """Write all files but pictures and return the track. An incomplete run keeps its log."""
        start = recorded.state.start
        track = assemble(
            start.model,
            recorded.estimates,
            held=start.held,
            timed=recorded.configuration.get("deadline_ms") is not None,
            up=up_of(recorded.configuration, recorded.state),
        )
        write_files(self.folder, track, TrackedBody(start.model, start.held), summary)
        write_atomically(self.folder / CSV_FILE, lambda file: write_csv(track, file))
        self._finished = complete
        return track


def write_files(folder: Path, track: Track, body: TrackedBody, summary: Mapping[str, object]) -> None:
    """Write `model.npz`, `track.npz` and `summary.json`."""
    write_atomically(folder / MODEL_FILE, lambda file: write_tracked_body(body, file))
    write_atomically(folder / TRACK_FILE, lambda file: write_track(track, file))
    write_json(folder / SUMMARY_FILE, summary)


def check_configuration(folder: Path, recorded: Mapping[str, Any], asked: RunConfiguration) -> None:
    """InputError that names what differs."""
    found = differences(recorded, asked)
    if found:
        raise InputError(
            f"{folder} was recorded with other options: {found}; give the same or choose another --out"
        )


def open_log(path: Path) -> int:
    """A descriptor of the log, locked; InputError if a run is still going on."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(
            f"{path.parent} is in use by a run that is still going on; choose another --out"
        ) from None
    if not path.exists() or path.stat().st_ino != os.fstat(descriptor).st_ino:  # that run ended just now
        os.close(descriptor)
        raise InputError(f"{path.parent} was in use until now; {ELSEWHERE}")
    return descriptor


def claim(
    folder: Path, configuration: RunConfiguration, *, resume: bool, frames: int | None = None
) -> Recorded | None:
    """What there is to go on with; InputError if anything is there that is not to be gone on with."""
    past = read_log(folder / LOG_FILE, frames)
    if past is not None:
        if not resume:
            raise InputError(f"{folder} holds an interrupted run; go on with --resume, {ELSEWHERE}")
        check_configuration(folder, past.configuration, configuration)
        return past
    present = [name for name in RESULTS if (folder / name).exists()]
    if present:
        (folder / LOG_FILE).unlink()
        raise InputError(f"{folder} holds an earlier run ({', '.join(present)}); {ELSEWHERE}")
    return None


def _remove_empty(folders: Sequence[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


def save_run(folder: Path, track: Track, body: TrackedBody, settings: Settings) -> None:
    """Write `track.npz`, `model.npz` and `summary.json`. InputError if any of them is there."""
    present = [name for name in (TRACK_FILE, MODEL_FILE, SUMMARY_FILE) if (folder / name).exists()]
    if present:
        raise InputError(f"{folder} holds a run already ({present[0]}); choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_files(folder, track, body, summary_of(folder, track, body, settings))
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder") from error


def summary_of(folder: Path, track: Track, body: TrackedBody, settings: Settings) -> dict[str, object]:
    """What is known of a run that was made from Python."""
    return {
        "sequence": folder.resolve().name,
        "model": {"name": body.model.name, "hash": body.model.hash, "active": body.model.dof_names},
        "method": settings.method,
        "preset": settings.preset,
        "seed": settings.seed,
        "settings": msgspec.to_builtins(settings),
        "versions": versions(),
        "frames": len(track.frame),
        "status": count_status(track.status),
        "particles": settings.filter.particles,
        "complete": True,
    }
