"""A run's folder: results made durable frame by frame, and its final files written whole at the end."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec
import numpy as np

from common.errors import InputError
from coordinator.atomic_file import sync_folder, write_atomically
from coordinator.estimate import Estimate
from coordinator.exports.csv import write_csv
from coordinator.frame_log import Entry, Opening, append_record, entry_of, estimate_of, read_records
from coordinator.track import TRACK_FILE, Track, write_track

LOG_FILE = "frames.log"
SUMMARY_FILE = "summary.json"
CSV_FILE = "poses.csv"
RESULTS = (TRACK_FILE, SUMMARY_FILE, CSV_FILE)
ELSEWHERE = "choose another --out or delete what is there"


class Recorder:
    """Owns a run's folder from the first frame to the last; a context manager.

    While it is open, `frames.log` grows and is locked against a second run. A folder in which nothing came
    to be recorded is left as it was found. Raises InputError if the folder is in use, holds an earlier
    run, or cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.frames = 0
        self._finished = False
        self._made: list[Path] = []
        try:
            self._made = _missing_parents(folder)
            folder.mkdir(parents=True, exist_ok=True)
            self._log = open_log(folder / LOG_FILE)
            sync_folder(folder)
        except OSError as error:
            _remove_empty(self._made)
            raise InputError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open_with(self, dof_names: Sequence[str], joint_names: Sequence[str]) -> None:
        """Say what every frame's pose and joints mean; once, before the first frame."""
        append_record(self._log, Opening(tuple(dof_names), tuple(joint_names)))

    def append(self, estimate: Estimate) -> None:
        """Make one frame's result durable."""
        append_record(self._log, entry_of(estimate))
        self.frames += 1

    def estimates(self) -> list[Estimate]:
        """Everything recorded so far, as it stands in the log."""
        return read_log(self.folder / LOG_FILE)[1]

    def finish(self, summary: Mapping[str, object], *, complete: bool = True) -> None:
        """Write `track.npz`, `poses.csv` and `summary.json` from what was recorded.

        An incomplete run keeps its log beside them.
        """
        track = assemble(*read_log(self.folder / LOG_FILE))
        write_atomically(self.folder / TRACK_FILE, lambda file: write_track(track, file))
        write_atomically(self.folder / CSV_FILE, lambda file: write_csv(track, file))
        text = msgspec.json.format(msgspec.json.encode(summary), indent=2)
        write_atomically(self.folder / SUMMARY_FILE, lambda file: file.write(text + b"\n"))
        self._finished = complete

    def close(self) -> None:
        """Give the folder free; without a frame, leave no trace of the run."""
        if self._finished or not self.frames:
            (self.folder / LOG_FILE).unlink(missing_ok=True)
        os.close(self._log)
        if not self.frames:
            _remove_empty(self._made)


def open_log(path: Path) -> int:
    """A descriptor of an empty, locked log; InputError if the folder belongs to another run."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
    try:
        _claim(descriptor, path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def assemble(opening: Opening, estimates: Sequence[Estimate]) -> Track:
    """The track of a run's estimates, in their order."""
    most = max((len(e.hypothesis_weight) for e in estimates), default=0)
    weight = np.full((len(estimates), most), np.nan)
    pose = np.full((len(estimates), most, len(opening.dof_names)), np.nan)
    for f, estimate in enumerate(estimates):
        count = len(estimate.hypothesis_weight)
        weight[f, :count], pose[f, :count] = estimate.hypothesis_weight, estimate.hypothesis_pose
    return Track(
        frame=np.array([e.frame for e in estimates], dtype=np.int64),
        time_s=np.array([e.time_s for e in estimates], dtype=np.float64),
        dof_names=opening.dof_names,
        pose=np.array([e.pose for e in estimates]).reshape(-1, len(opening.dof_names)),
        joint_names=opening.joint_names,
        joint_positions=np.array([e.joint_positions for e in estimates]).reshape(
            -1, len(opening.joint_names), 3
        ),
        hypothesis_pose=pose,
        hypothesis_weight=weight,
        status=np.array([e.status for e in estimates], dtype="<U9"),
    )


def read_log(path: Path) -> tuple[Opening, list[Estimate]]:
    """What an interrupted run recorded. Raises InputError if that is nothing."""
    records = list(read_records(path.read_bytes()))
    if not records or not isinstance(records[0], Opening):
        raise InputError(f"{path} holds no frame; track the sequence again")
    return records[0], [estimate_of(r) for r in records if isinstance(r, Entry)]


def _claim(descriptor: int, path: Path) -> None:
    folder = path.parent
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            f"{folder} is in use by a run that is still going on; choose another --out"
        ) from None
    if not path.exists() or path.stat().st_ino != os.fstat(descriptor).st_ino:  # that run ended just now
        raise InputError(f"{folder} was in use until now; {ELSEWHERE}")
    present = [name for name in RESULTS if (folder / name).exists()]
    if os.fstat(descriptor).st_size:
        raise InputError(f"{folder} holds an interrupted run; {ELSEWHERE}")
    if present:
        path.unlink()
        raise InputError(f"{folder} holds an earlier run ({', '.join(present)}); {ELSEWHERE}")


def _missing_parents(folder: Path) -> list[Path]:
    """`folder` and the folders above it that do not exist yet, innermost first."""
    return [path for path in (folder, *folder.parents) if not path.exists()]


def _remove_empty(folders: Sequence[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
