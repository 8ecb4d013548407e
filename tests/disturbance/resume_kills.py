"""Coordinators that are killed at random moments, and gone on with.

Call it by `python -m tests.disturbance.resume_kills`.

Each time a run is ended by SIGKILL somewhere between its start and its end, and the same command with
`--resume` follows. It must end with the bytes of a run that was left alone. The workers outlive them all.
Prints one JSON object; exit code 1 if not.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from coordinator.results.log import read_log
from tests.support.processes.warm_processes import Workers, coordinate, start
from tests.support.small_sequence import write_small_sequence

KILLS = 20
FRAMES = 40
LONGEST = 0.5  # seconds from the moment that was waited for to the kill


@dataclass(frozen=True, slots=True)
class Killed:
    """What became of one run that was killed."""

    aimed_at: int  # frames recorded
    recorded: int
    torn: bool  # the last record
    complete: bool  # it had ended before
    identical: bool


class Place:
    """A sequence, and where runs of it and their workers meet."""

    def __init__(self, folder: Path, frames: int) -> None:
        self.folder = folder
        self.sequence = folder / "sequence"
        self.endpoint = f"unixsock-stream/{folder / 'bus'}"
        self.log = folder / "log.txt"
        write_small_sequence(self.sequence, frames)

    def finish(self, out: Path, *options: str) -> int | None:
        """Run to the end; gives the exit code."""
        process = start(coordinate, self.sequence, out, self.endpoint, *options, log=self.log)
        process.join()
        return process.exitcode

    def kill(self, out: Path, now: Callable[[], bool], delay: float) -> None:
        """Start a run and kill it a while after it is time to, or when it has ended."""
        process = start(coordinate, self.sequence, out, self.endpoint, log=self.log)
        while process.is_alive() and not now():
            time.sleep(0.002)
        time.sleep(delay)
        process.kill()
        process.join()


def kill_and_resume(place: Place, out: Path, calm: bytes, aimed_at: int, delay: float) -> Killed:
    """One run, killed after so many frames or while it starts, and gone on with."""
    log = out / "frames.log"
    place.kill(out, lambda: count(log) >= aimed_at, delay)
    past = read_log(log) if log.exists() else None
    complete = not log.exists() and (out / "track.npz").exists()
    torn = past is not None and past.end < log.stat().st_size
    ended = place.finish(out, "--resume")
    same = ended == 0 and (out / "track.npz").read_bytes() == calm and not log.exists()
    return Killed(aimed_at, past.frames if past else 0, torn, complete, same)


def count(log: Path) -> int:
    """Frames in a log that is being written."""
    try:
        past = read_log(log)
    except FileNotFoundError:
        return 0
    return past.frames if past else 0


def try_all(kills: int, frames: int, seed: int, longest: float = LONGEST) -> list[Killed]:
    """Kill as many runs, each at a moment of its own that is anywhere between a run's start and its end.

    The kill follows at most `longest` seconds after the frame that was waited for. A run that
    had ended before its moment came is result too, but counts for nothing.
    """
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="gepf-kills-") as name:
        place = Place(Path(name), frames)
        with Workers((place.endpoint,), place.log, {"b": 2}) as workers:
            workers.start("a")
            workers.start("b")
            if place.finish(place.folder / "calm") != 0:
                raise SystemExit(place.log.read_text())
            calm = (place.folder / "calm" / "track.npz").read_bytes()
            killed: list[Killed] = []
            while hits(killed) < kills:
                aimed_at, delay = rng.randrange(frames + 1), rng.uniform(0.0, longest)
                out = place.folder / str(len(killed))
                killed.append(kill_and_resume(place, out, calm, aimed_at, delay))
            return killed


def hits(killed: list[Killed]) -> int:
    """How many were killed before they had ended."""
    return sum(not each.complete for each in killed)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Runs that are killed and gone on with.")
    parser.add_argument("--kills", type=int, default=KILLS)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    killed = try_all(options.kills, options.frames, options.seed)
    result = {
        "kills": hits(killed),
        "identical": sum(each.identical for each in killed),
        "torn": sum(each.torn for each in killed),
        "had_ended_before": sum(each.complete for each in killed),
        "frames_recorded_at_the_kill": [each.recorded for each in killed],
    }
    sys.stdout.write(json.dumps(result, indent=2) + "\n")
    return 0 if result["identical"] == len(killed) else 1


if __name__ == "__main__":
    sys.exit(main())
