"""The folder of a live run: estimates are recorded frame by frame, the final files written at the end.

A run that was killed is finished by whoever reads its folder.
"""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from itertools import zip_longest
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gepf.common.errors import InputError
from gepf.coordinator.files import LIVE_FILE, LOG_FILE
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.configuration import RunConfiguration
from gepf.coordinator.results.live_log import (
    LiveBodies,
    LiveFrame,
    LiveOpening,
    LivePerson,
    Record,
    append_chunk,
    as_estimate,
    is_empty,
    open_container,
    read_chunks,
)
from gepf.coordinator.results.log import floor_up
from gepf.coordinator.results.recorder import (
    ELSEWHERE,
    begin_log,
    open_log,
    refuse_results,
    remove_empty,
    write_run,
)
from gepf.coordinator.results.summary import RunTotals
from gepf.coordinator.results.tally import Outcome, Tally
from gepf.coordinator.scene.scene import SceneChanges
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.reporting import TrackedFrame
from gepf.coordinator.tracking.state import Start

logger = logging.getLogger(__name__)


class LiveRecorder:
    """Owns the folder of a live run; a context manager.

    While it is open, `live.mcap` grows and is locked against a second run. It is deleted when the final files
    are written. If no frame is recorded, the folder is not changed. `pool` is for the summary.

    InputError if the folder is in use, cannot be written, or holds a run.
    """

    state = None

    def __init__(self, run: Path, configuration: RunConfiguration, pool: Mapping[str, object]) -> None:
        self.run, self.frames = run, 0
        self._opening = LiveOpening(configuration, dict(pool))
        self._finished = False
        descriptor, self._made = begin_log(run, LIVE_FILE)
        self._file = os.fdopen(descriptor, "wb")
        try:
            refuse_other_run(run)
        except BaseException:
            self._file.close()
            raise
        self._file.truncate(0)
        self._starts: list[Start] = []
        self._scenes = SceneChanges()  # the last of each camera
        self._disk = ThreadPoolExecutor(1)
        self._syncing: Future[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Release the folder; without a frame, remove all files of the run."""
        self._disk.shutdown()
        try:
            if self._finished or not self.frames:
                (self.run / LIVE_FILE).unlink(missing_ok=True)
        finally:
            with suppress(OSError):  # what the disk had no space for before
                self._file.close()
        if not self.frames:
            remove_empty(self._made)

    def append(self, tracked: TrackedFrame, statistics: PoolStatistics, seconds: float) -> None:
        """Write the results of one frame.

        When this returns, readers see them, and they survive the end of this process. The disk gets them as
        fast as it can, without delaying the next frame: if power is lost, what it did not get is lost.
        """
        self._scenes.update(tracked.state.scene_changes)
        floor = floor_up(self._scenes)
        up = None if floor is None else floor.tolist()
        starts = [person.state.start for person in tracked.people]
        records: list[Record] = []
        if not self.frames:
            open_container(self._file)
            records.append(self._opening)
        changed = [new if new is not old else None for new, old in zip_longest(starts, self._starts)]
        if any(changed):
            records.append(LiveBodies(changed))
        people = [
            LivePerson(
                as_values(person.estimate), person.state.shape.tolist(), person.state.stature_deviation, up
            )
            for person in tracked.people
        ]
        append_chunk(self._file, self.frames, [*records, LiveFrame(people, statistics, seconds)])
        if self._syncing is None or self._syncing.done():
            if self._syncing is not None:
                self._syncing.result()
            self._syncing = self._disk.submit(os.fdatasync, self._file.fileno())
        self._starts = starts
        self.frames += 1

    def finish(self, facts: Mapping[str, object], rate: float) -> dict[int, Outcome]:
        """Write all files but pictures of each found person, and always of the first; returns them by number.

        Each summary starts with `facts` and the frame rate in frames per second.
        """
        if not self.frames:
            return {}
        found = finish_log(self.run, facts, rate)
        self._finished = True
        return found


def as_values(estimate: Estimate) -> dict[str, Any]:
    """The fields of an estimate by name."""
    return {name: getattr(estimate, name) for name in Estimate.__dataclass_fields__}


def refuse_other_run(folder: Path) -> None:
    """InputError if the folder of a new live run, whose lock is held, holds another run."""
    if not is_empty(folder / LIVE_FILE):
        raise InputError(
            f"{folder} holds a live run that was killed; finish it with gepf report {folder}, {ELSEWHERE}"
        )
    try:
        refuse_interrupted(folder)
        refuse_results(folder)
    except InputError:
        (folder / LIVE_FILE).unlink()
        raise


def refuse_interrupted(folder: Path) -> None:
    """InputError if a folder holds an interrupted run of a recording, or one that goes on."""
    log = folder / LOG_FILE
    if log.exists() and log.stat().st_size:
        os.close(open_log(log))  # InputError if it goes on
        kept = f"{folder} holds an interrupted run of a recording"
        raise InputError(f"{kept}; continue it with its own gepf track command and --resume; {ELSEWHERE}")


def read_frames(path: Path) -> Iterator[LiveFrame]:
    """The complete frames of a container."""
    return (record for chunk in read_chunks(path) for record in chunk if isinstance(record, LiveFrame))


def finish_log(run: Path, facts: Mapping[str, object], rate: float = 0.0) -> dict[int, Outcome]:
    """Write the files of a run from its container, which has a frame; returns the people by number.

    The container is read frame by frame, and arrays as long as the run are in files: memory hardly grows with
    the frames.
    """
    path = run / LIVE_FILE
    openings: list[LiveOpening] = []
    starts: list[Start | None] = []
    tallies: list[Tally] = []
    last: LiveFrame | None = None
    for chunk in read_chunks(path):
        for record in chunk:
            match record:
                case LiveOpening():
                    openings.append(record)
                case LiveBodies():
                    starts = [new or old for new, old in zip_longest(record.starts, starts)]
                case LiveFrame():
                    last = record
                    tallies = tallies or [Tally() for _ in record.people]
                    for tally, each in zip(tallies, record.people, strict=True):
                        tally.add(as_estimate(each.estimate))
    if last is None:
        return {}
    people = [
        Outcome(
            start,
            np.array(each.shape),
            each.stature_deviation,
            None if each.up is None else np.array(each.up),
            tally,
        )
        for start, each, tally in zip(starts, last.people, tallies, strict=True)
        if start is not None  # it is recorded with the first frame
    ]
    opening, frames = openings[0], tallies[0].frames
    totals = RunTotals(opening.configuration, last.statistics, last.seconds)
    facts = {"complete": False, "pool": opening.pool, **facts}
    facts = {**facts, "frame_rate": rate or frames / max(last.seconds, 1e-9)}

    def estimates(person: int) -> Iterable[Estimate]:
        return (as_estimate(frame.people[person].estimate) for frame in read_frames(path))

    return write_run(run, totals, people, facts, estimates, InFiles(run), packed=True)


class InFiles:
    """Allocates arrays in temporary files of a folder; the files have no names and vanish with the arrays."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
        """An array of zeros."""
        if not np.prod(shape):
            return np.zeros(shape, kind)
        with tempfile.TemporaryFile(dir=self._folder) as file:
            return np.memmap(file, kind, "w+", shape=shape)


def finish_live(run: Path) -> None:
    """Finish the live run that was killed in a folder, and say so; delete its container.

    InputError if a run goes on there, the folder cannot be written, or the run was killed before its first
    frame.
    """
    path = run / LIVE_FILE
    try:
        log = open_log(path)
    except InputError:
        raise InputError(f"the live run in {run} has not ended; end it with Ctrl-C, then try again") from None
    except OSError as error:
        raise InputError(f"cannot finish the run in {run}: {error.strerror}; make {run} writable") from error
    with closing(os.fdopen(log)):
        found = finish_log(run, {})
        if not found:
            raise InputError(f"the live run in {run} was killed before its first frame; delete {path}")
        frames = max(person.tally.frames for person in found.values())
        logger.warning("the live run in %s was killed; its %d frames are now in its results", run, frames)
        path.unlink()


class Unstored:
    """Counts the frames of a live run whose results are published and shown, but not stored."""

    state = None

    def __init__(self) -> None:
        self.frames = 0
        self._people: list[Outcome] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """There is nothing to release."""

    def append(self, tracked: TrackedFrame, statistics: PoolStatistics, seconds: float) -> None:
        """Count one frame."""
        del statistics, seconds
        tallies = [outcome.tally for outcome in self._people] or [Tally() for _ in tracked.people]
        for tally, person in zip(tallies, tracked.people, strict=True):
            tally.add(person.estimate)
        self._people = [
            Outcome(person.state.start, person.state.shape, person.state.stature_deviation, None, tally)
            for person, tally in zip(tracked.people, tallies, strict=True)
        ]
        self.frames += 1

    def finish(self, facts: Mapping[str, object], rate: float) -> dict[int, Outcome]:
        """Each person found, and the first, by number."""
        del facts, rate
        return {n: each for n, each in enumerate(self._people, start=1) if n == 1 or each.found}
