"""A run whose workers are killed, frozen and slowed all the time, beside a calm one.

Call it by `python -m tests.disturbance.chaos`.

As soon as a frame is recorded all four workers are frozen and killed with what they have. Then every half
second one of them, chosen at random, is

- killed, and started again under its name after a while,
- frozen, briefly or for longer than the bus waits for it,
- slowed tenfold for a while, by stopping it nine tenths of the time, or
- doubled: frozen while another one of the same name starts, and killed later.

The run must end with all frames and the bytes of the calm one. Prints one JSON object; exit code 1 if not.
"""

from __future__ import annotations

import argparse
import heapq
import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from tests.support.processes.warm_processes import Workers, coordinate, start

WORKERS = tuple(f"w{k}" for k in range(4))
LANES = dict(zip(WORKERS, (1, 1, 2, 3), strict=True))
FRAMES = 300
BOUND = 300.0  # seconds for either run
EVERY = 0.5  # seconds between two acts
STUCK = 0.3  # seconds in which a frame is sent to workers that are all frozen
SLICE = 0.1  # seconds, a tenth of which a slowed worker may work


@dataclass
class Chaos:
    """Disturbs workers at random, seeded; what is to be done later waits in an agenda."""

    workers: Workers
    rng: random.Random
    acts: Counter[str] = field(default_factory=Counter)
    _agenda: list[tuple[float, int, Callable[[], None]]] = field(default_factory=list)
    _busy: set[str] = field(default_factory=set)
    _count: int = 0

    def act(self, now: float) -> None:
        """Do something to all workers at first, then to one that is not being disturbed yet."""
        victims = [name for name in WORKERS if name not in self._busy]
        if not self.acts:
            self.ambush(now)
        elif victims:
            name = self.rng.choice(victims)
            act = self.rng.choice([self.kill, self.freeze, self.slow, self.double])
            self.acts[act.__name__] += 1
            self._busy.add(name)
            act(name, now)

    def ambush(self, now: float) -> None:
        """Freeze all, so that the request that comes next stays with them, and kill them with it."""
        self.acts["ambush"] += 1
        for name in WORKERS:
            self._busy.add(name)
            self.workers.freeze(name)
            self._at(now + STUCK, partial(self._renew, name), name)

    def catch_up(self, now: float) -> None:
        """Do what is due."""
        while self._agenda and self._agenda[0][0] <= now:
            heapq.heappop(self._agenda)[2]()

    def kill(self, name: str, now: float) -> None:
        """SIGKILL, and a new one under the same name, at once or later."""
        self.workers.kill(name)
        self._at(now + self.rng.choice([0.0, 0.2, 1.0]), lambda: self.workers.start(name), name)

    def freeze(self, name: str, now: float) -> None:
        """SIGSTOP, and SIGCONT before or after the bus gives it up."""
        self.workers.freeze(name)
        self._at(now + self.rng.choice([0.1, 0.5, 3.0]), lambda: self.workers.thaw(name), name)

    def slow(self, name: str, now: float) -> None:
        """Run a tenth of the time for two seconds."""
        slices = 20
        for k in range(slices):
            self._at(now + k * SLICE, lambda: self.workers.freeze(name))
            self._at(now + (k + 0.9) * SLICE, lambda: self.workers.thaw(name))
        self._at(now + slices * SLICE, lambda: self.workers.thaw(name), name)

    def double(self, name: str, now: float) -> None:
        """Freeze one, start another of its name; both are killed and one is started later."""
        self.workers.freeze(name)
        self.workers.start(name)
        self._at(now + 2.0, partial(self._renew, name), name)

    def _renew(self, name: str) -> None:
        self.workers.kill(name)
        self.workers.start(name)

    def _at(self, when: float, do: Callable[[], None], frees: str | None = None) -> None:
        def done() -> None:
            do()
            self._busy.discard(frees or "")

        self._count += 1
        heapq.heappush(self._agenda, (when, self._count, done))


def run(sequence: Path, out: Path, seed: int | None, bound: float) -> dict[str, Any]:
    """Track with four workers, disturbed if there is a seed; gives what happened."""
    endpoint, log = f"unixsock-stream/{out}.sock", out.with_suffix(".txt")
    began = time.monotonic()
    process = start(coordinate, sequence, out, endpoint, log=log)
    try:
        with Workers((endpoint,), log.with_suffix(".workers.txt"), LANES) as workers:
            for name in WORKERS:
                workers.start(name)
            chaos = Chaos(workers, random.Random(seed))
            while process.is_alive() and time.monotonic() - began < bound:
                disturb(chaos, begun=seed is not None and has_frames(out / "frames.log"))
    finally:
        process.kill()
        process.join()
    return {
        "exit_code": process.exitcode,
        "seconds": round(time.monotonic() - began, 1),
        "acts": chaos.acts,
        "said_last": log.read_text().splitlines()[-1:],
    }


def has_frames(log: Path) -> bool:
    """Whether a frame is recorded."""
    return log.exists() and log.stat().st_size > 0


def disturb(chaos: Chaos, *, begun: bool) -> None:
    """Half a second of it, or a moment if nothing is to be disturbed yet."""
    if begun:
        chaos.act(time.monotonic())
    until = time.monotonic() + (EVERY if begun else 0.01)
    while time.monotonic() < until:
        chaos.catch_up(time.monotonic())
        time.sleep(0.005)


def compare(frames: int, seed: int, bound: float) -> dict[str, Any]:
    """A calm and a disturbed run of the same sequence."""
    from tests.support.small_sequence import write_small_sequence

    with tempfile.TemporaryDirectory(prefix="gepf-chaos-") as name:
        folder = Path(name)
        write_small_sequence(folder / "sequence", frames)
        calm = run(folder / "sequence", folder / "calm", None, bound)
        wild = run(folder / "sequence", folder / "wild", seed, bound)
        tracks = [folder / kind / "track.npz" for kind in ("calm", "wild")]
        summary = folder / "wild" / "summary.json"
        content = json.loads(summary.read_text()) if summary.exists() else {}
        return {
            "identical": all(t.exists() for t in tracks) and tracks[0].read_bytes() == tracks[1].read_bytes(),
            "acts": wild["acts"].total(),
            "frames": content.get("frames", 0),
            "frames_lost": frames - content.get("frames", 0),
            **{key: content.get(key) for key in ("batches_sent", "batches_sent_again", "batches_refused")},
            "workers_seen": content.get("workers_seen"),
            "calm": calm,
            "wild": wild,
        }


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="A disturbed run beside a calm one.")
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bound", type=float, default=BOUND, help="seconds for either run")
    options = parser.parse_args()
    result = compare(options.frames, options.seed, options.bound)
    sys.stdout.write(json.dumps(result, indent=2) + "\n")
    return 0 if result["identical"] and result["frames_lost"] == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
