"""Where runs of one small sequence and their workers meet, each of them a process."""

from __future__ import annotations

from multiprocessing.process import BaseProcess
from pathlib import Path

from gepf.coordinator.results.log import read_log
from tests.support.processes.warm_processes import Workers, coordinate, start
from tests.support.small_sequence import write_small_sequence


class Place:
    """A folder with a sequence of this number of frames."""

    def __init__(self, folder: Path, frames: int) -> None:
        self.folder = folder
        self.endpoint = f"unixsock-stream/{folder / 'bus'}"
        self.log = folder / "log.txt"
        write_small_sequence(folder / "sequence", frames)

    def workers(self, **lanes: int) -> Workers:
        """Workers by name with their lanes; they end with the context."""
        workers = Workers((self.endpoint,), self.log, lanes)
        for name in lanes:
            workers.start(name)
        return workers

    def begin(self, out: Path, *options: str, log: Path | None = None) -> BaseProcess:
        """A run, which writes to standard error what goes to the log."""
        return start(coordinate, self.folder / "sequence", out, self.endpoint, *options, log=log or self.log)

    def finish(self, out: Path, *options: str) -> bytes:
        """A run to its end; gives its track."""
        run = self.begin(out, *options)
        run.join()
        assert run.exitcode == 0, self.log.read_text()
        return (out / "track.npz").read_bytes()


def recorded(out: Path) -> int:
    """Frames in the log of a run."""
    try:
        past = read_log(out / "frames.log")
    except FileNotFoundError:
        return 0
    return past.frames if past else 0
