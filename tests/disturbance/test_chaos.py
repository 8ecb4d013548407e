"""Real processes that are killed, frozen and slowed: no byte of a run changes."""

from __future__ import annotations

import json
import random
import signal
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

from tests.support.processes.place import Place, recorded
from tests.support.processes.programs import in_thread, wait_until
from tests.support.processes.warm_processes import Workers

LANES = {"a": 1, "b": 1, "c": 2, "d": 3}  # by worker


def disturb(workers: Workers, name: str, stop: threading.Event) -> None:
    """Kill a worker with the request that it has, and then do one thing after the other to it."""
    rng = random.Random(name)
    workers.freeze(name)
    stop.wait(0.3)  # a request comes, and stays
    workers.kill(name)
    workers.start(name)
    while not stop.wait(rng.uniform(0.5, 2.0)):
        match rng.choice(("kill", "freeze", "slow", "double")):
            case "kill":
                workers.kill(name)
                stop.wait(rng.choice((0.0, 0.2, 1.0)))
                workers.start(name)
            case "freeze":  # for less time than the bus waits for it, or for longer
                workers.freeze(name)
                stop.wait(rng.choice((0.1, 0.5, 3.0)))
                workers.thaw(name)
            case "slow":  # to a tenth
                for _ in range(20):
                    workers.freeze(name)
                    stop.wait(0.09)
                    workers.thaw(name)
                    stop.wait(0.01)
            case "double":  # another one of the same name starts
                workers.freeze(name)
                workers.start(name)
                stop.wait(2.0)
                workers.kill(name)
                workers.start(name)


@pytest.mark.parametrize("frames", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_workers_that_are_killed_frozen_and_slowed_change_no_byte(tmp_path: Path, frames: int) -> None:
    """No frame is lost, though requests died with their workers and were sent again."""
    place, out = Place(tmp_path, frames), tmp_path / "disturbed"
    with place.workers(**LANES) as workers, ExitStack() as stack:
        calm = place.finish(tmp_path / "calm")
        run = place.begin(out)
        wait_until(lambda: recorded(out) > 0)
        for name in LANES:
            stack.enter_context(in_thread(partial(disturb, workers, name)))
        run.join(300.0)
        run.kill()
    assert run.exitcode == 0, place.log.read_text()
    assert (out / "track.npz").read_bytes() == calm
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames"] == frames
    assert summary["batches_sent_again"] > 0


@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_killed_coordinator_goes_on_with_the_same_bytes(tmp_path: Path, kills: int) -> None:
    """At any time of the run."""
    place, rng, hits = Place(tmp_path, 40), random.Random(2), 0
    with place.workers(a=1, b=2):
        calm = place.finish(tmp_path / "calm")
        for number in range(kills):
            out, aimed_at = tmp_path / str(number), rng.randrange(30)
            run = place.begin(out)
            while run.is_alive() and recorded(out) < aimed_at:
                time.sleep(0.002)
            time.sleep(rng.uniform(0.0, 0.05))
            run.kill()
            run.join()
            hits += run.exitcode == -signal.SIGKILL and recorded(out) > 0
            assert place.finish(out, "--resume") == calm
            assert not (out / "frames.log").exists()
    assert hits > 0
