"""The folder of a run: results are recorded frame by frame, and the final files are written at the end."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from gepf.common.errors import InputError
from gepf.coordinator.files import (
    LIVE_FILE,
    LOG_FILE,
    SUMMARY_FILE,
    sync_folder,
    write_atomically,
    write_json,
)
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.configuration import RunConfiguration, differences, versions
from gepf.coordinator.results.csv_file import write_csv
from gepf.coordinator.results.live_log import is_empty
from gepf.coordinator.results.log import (
    Entry,
    Opening,
    Recorded,
    append_records,
    assemble,
    floor_up,
    read_log,
)
from gepf.coordinator.results.summary import (
    PERSON,
    PERSON_FILE,
    RunTotals,
    find_summary,
    folder_of,
    summarise,
    summarise_all,
)
from gepf.coordinator.results.tally import Outcome, count_status
from gepf.coordinator.results.track import (
    MODEL_FILE,
    TRACK_FILE,
    NewArray,
    Track,
    TrackedBody,
    write_track,
    write_tracked_body,
)
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.reporting import TrackedFrame
from gepf.coordinator.tracking.state import TrackerState

CSV_FILE = "poses.csv"
RESULTS = (TRACK_FILE, SUMMARY_FILE, CSV_FILE)
ELSEWHERE = "choose another --out or delete what is there"


class Recorder:
    """Owns the folder of a run; a context manager.

    While it is open, `frames.log` grows and is locked against a second run. It is deleted when a complete run
    is closed without an error. If no frame is recorded, the folder is not changed.

    With `resume`, the run in the folder is continued, if there is one. InputError if the folder is in use,
    cannot be written, or holds a run that cannot be continued.
    """

    def __init__(self, run: Path, configuration: RunConfiguration, *, resume: bool = False) -> None:
        self.run, self._configuration = run, configuration
        self._finished = self._opened = False
        self._log, self._made = begin_log(run, LOG_FILE)
        try:
            self.past = claim(run, configuration, resume=resume)
        except BaseException:
            os.close(self._log)
            raise
        people = self.past.people if self.past else []
        self.frames = self.past.frames if self.past else 0
        self._starts = [person.state.start for person in people]
        os.ftruncate(self._log, self.past.end if self.past else 0)
        self._disk = ThreadPoolExecutor(1)
        self._syncing: Future[None] = self._disk.submit(os.fdatasync, self._log)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Release the folder; without a frame, remove all files of the run."""
        self._disk.shutdown()
        empty = os.fstat(self._log).st_size == 0
        try:
            if empty or (self._finished and kind is None):
                (self.run / LOG_FILE).unlink(missing_ok=True)
        finally:
            os.close(self._log)
        if empty:
            remove_empty(self._made)

    @property
    def state(self) -> TrackerState | None:
        """The state of the tracker at the end of the interrupted run; None for a new run."""
        return self.past.state if self.past else None

    def append(self, tracked: TrackedFrame, statistics: PoolStatistics, seconds: float) -> None:
        """Write the results of one frame, and the state of the tracker after it.

        When this returns, readers see them, and they survive the end of this process. They survive a loss of
        power some milliseconds later, at the latest when the next frame is appended or the results are read.
        So the disk writes while the workers refine. `statistics` and `seconds` are those since this recorder
        was opened.
        """
        if self.past:
            statistics, seconds = statistics.after(self.past.statistics), seconds + self.past.seconds
        starts = [person.state.start for person in tracked.people]
        entry = Entry(
            frame=tracked.state,
            starts=[new if new is not old else None for new, old in zip_longest(starts, self._starts)],
            checkpoints=[person.state.checkpoint for person in tracked.people],
            estimates=[person.estimate for person in tracked.people],
            statistics=statistics,
            seconds=seconds,
        )
        self._syncing.result()
        append_records(self._log, [entry] if self._opened else [Opening(self._configuration), entry])
        self._syncing = self._disk.submit(os.fdatasync, self._log)
        self._starts, self._opened = starts, True
        self.frames += 1

    def finish(self, facts: Mapping[str, object], rate: float) -> dict[int, Outcome]:
        """Write all files except pictures for each person found, and for the first; returns them by number.

        Each summary starts with `facts`, including whether the run is complete, and the frame rate in frames
        per second; 0 if no frame was tracked now. Nothing is written before the first frame. An incomplete
        run keeps its log.
        """
        self._syncing.result()
        recorded = read_log(self.run / LOG_FILE)
        if recorded is None:
            return {}
        up = floor_up(recorded.frame.scene_changes)
        people = [person.outcome(up) for person in recorded.people]
        facts = {**facts, "frame_rate": rate or recorded.frames / max(recorded.seconds, 1e-9)}
        found = write_run(self.run, recorded, people, facts, lambda p: recorded.people[p].estimates)
        self._finished = bool(facts["complete"])
        return found


def write_run(
    run: Path,
    totals: RunTotals,
    people: Sequence[Outcome],
    facts: Mapping[str, object],
    estimates: Callable[[int], Iterable[Estimate]],
    new: NewArray = np.empty,
    *,
    packed: bool = False,
) -> dict[int, Outcome]:
    """Write all files except pictures of each found person, and always of the first; returns them by number.

    Each summary starts with `facts`. `estimates` returns the estimates of a person by index, which are read
    only once; `new` allocates the arrays for them. With `packed`, tracks are compressed.
    """
    configuration = totals.configuration
    said = configuration.get("scene", {}).get("up")
    found = {n: person for n, person in enumerate(people, start=1) if n == 1 or person.found}
    for number, person in found.items():
        start, tally, body = person.start, person.tally, person.start.body_of(person.shape)
        up = person.up if said is None else np.array(said)
        track = assemble(body, estimates(number - 1), held=start.held, up=up, tally=tally, new=new)
        own = {} if len(people) == 1 else {PERSON: number}
        summary = {**facts, **summarise(totals, person), **own}
        folder = folder_of(run, len(people), number)
        if person.found and configuration["model"]["content"] is None:  # the size was not known
            measures = start.family.size_file(start.size_of(person.shape), person.stature_deviation)
            if measures:
                folder.mkdir(parents=True, exist_ok=True)
                write_json(folder / PERSON_FILE, measures)
        write_files(folder, track, TrackedBody(body, start.held), summary, packed=packed)
    if len(people) > 1:
        write_json(run / SUMMARY_FILE, {**facts, **summarise_all(totals, found)})
    return found


def write_files(
    folder: Path, track: Track, body: TrackedBody, summary: Mapping[str, object], *, packed: bool = False
) -> None:
    """Write all files of one person except pictures; the folder is created if it is missing.

    The summary is the last: where it is, all others are.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / MODEL_FILE, lambda file: write_tracked_body(body, file))
    write_atomically(folder / TRACK_FILE, lambda file: write_track(track, file, packed=packed))
    write_atomically(folder / CSV_FILE, lambda file: write_csv(track, file))
    write_json(folder / SUMMARY_FILE, summary)


def is_complete(run: Path, configuration: RunConfiguration) -> bool:
    """Whether a folder holds a complete run; InputError if its configuration differs."""
    summary = find_summary(run)
    if summary is None or (run / LOG_FILE).exists():
        return False
    check_configuration(run, summary, configuration)
    return summary.get("complete") is True


def check_configuration(folder: Path, recorded: Mapping[str, Any], asked: RunConfiguration) -> None:
    """InputError that names the differences, if there are any."""
    found = differences(recorded, asked)
    if found:
        raise InputError(f"{folder} was recorded with other options: {found}; choose another --out")


def begin_log(run: Path, name: str) -> tuple[int, list[Path]]:
    """A locked descriptor of the log in the folder of a run, and the folders that were made for it.

    InputError if the folder is in use or cannot be written.
    """
    made: list[Path] = []
    try:
        made = [path for path in (run, *run.parents) if not path.exists()]
        run.mkdir(parents=True, exist_ok=True)
        log = open_log(run / name)
        sync_folder(run)
    except OSError as error:
        remove_empty(made)
        raise InputError(f"cannot write to {run}: {error.strerror}; choose another --out") from error
    return log, made


def open_log(path: Path) -> int:
    """A locked descriptor of the log; InputError if another run uses it."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(f"{path.parent} is in use by another run; choose another --out") from None
    if not path.exists() or path.stat().st_ino != os.fstat(descriptor).st_ino:  # the other run just ended
        os.close(descriptor)
        raise InputError(f"{path.parent} was in use until now; {ELSEWHERE}")
    return descriptor


def claim(folder: Path, configuration: RunConfiguration, *, resume: bool) -> Recorded | None:
    """The run to continue; InputError if the folder holds something that cannot be continued."""
    past = read_log(folder / LOG_FILE)
    if past is not None:
        if not resume:
            raise InputError(f"{folder} holds an interrupted run; continue it with --resume, {ELSEWHERE}")
        check_configuration(folder, past.configuration, configuration)
        return past
    try:
        refuse_killed(folder)
        refuse_results(folder)
    except InputError:
        (folder / LOG_FILE).unlink()
        raise
    return None


def refuse_killed(folder: Path) -> None:
    """InputError if a folder holds a live run, killed or not."""
    live = folder / LIVE_FILE
    if live.exists() and not is_empty(live):
        os.close(open_log(live))  # InputError if it goes on
        raise InputError(
            f"{folder} holds a live run that was killed; finish it with gepf report {folder}, {ELSEWHERE}"
        )


def refuse_results(folder: Path) -> None:
    """InputError if a folder holds the files of an earlier run."""
    present = [name for name in RESULTS if (folder / name).exists()]
    if present:
        raise InputError(f"{folder} holds an earlier run ({', '.join(present)}); {ELSEWHERE}")


def remove_empty(folders: Sequence[Path]) -> None:
    """Remove folders, from the innermost out, as far as they are empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def save_run(folder: Path, track: Track, body: TrackedBody, settings: Settings) -> None:
    """Write the results of a run from Python. InputError if the folder already has results."""
    present = [name for name in (*RESULTS, MODEL_FILE) if (folder / name).exists()]
    if present:
        raise InputError(f"{folder} already holds a run ({present[0]}); choose another folder")
    summary = {
        "sequence": folder.resolve().name,
        "model": {"name": body.model.name, "hash": body.model.hash, "active": body.model.dof_names},
        "settings": msgspec.to_builtins(settings),
        "method": settings.method,
        "preset": settings.preset,
        "seed": settings.seed,
        "particles": settings.filter.particles,
        "versions": versions(),
        "frames": len(track.frame),
        "status": count_status(track.status.tolist()),
    }
    try:
        write_files(folder, track, body, summary)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder") from error
