"""Live input in the library: frames from a real publisher over Zenoh, tracked as they come."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path

import msgspec
import numpy as np

import gepf
from gepf.common.protocol.frames import LIVE_END, encode_live
from tests.support.live import KEY, publishing, until_released
from tests.support.people import SETTINGS, STANDING, as_bytes, shown
from tests.support.processes.warm_processes import gepf as gepf_command
from tests.support.processes.warm_processes import start
from tests.support.small_sequence import write_small_sequence

ROOT = Path(__file__).parents[2]
PERSON = gepf.Measures.of(1.82)
END = LIVE_END


def test_a_tracker_follows_live_input_to_its_end(endpoint: str, tmp_path: Path) -> None:
    """Each frame that is waited for is tracked under its own number, and the run is saved from it.

    With one particle, time does not change the results.
    """
    settings = msgspec.structs.replace(
        SETTINGS, pace_iterations=0.0, filter=msgspec.structs.replace(SETTINGS.filter, particles=1)
    )
    frames = shown("standing").frames[:3]
    done = threading.Semaphore(0)
    steps = ({KEY: message} for message in [*(encode_live(frame.views[0]) for frame in frames), END])
    with publishing(endpoint, [KEY], steps, until_released(done)):
        live = gepf.live(KEY, listen=endpoint, idle_timeout=60.0)
        tracker = gepf.Tracker(PERSON, settings, start=STANDING)
        found = []
        for estimate in tracker.follow(live):
            found.append(estimate)
            done.release()
    alone = gepf.Tracker(PERSON, settings, start=STANDING)
    assert [as_bytes(e) for e in found] == [as_bytes(alone.track(frame)) for frame in frames]
    assert (live.counts["received"], live.counts["skipped"], live.counts["malformed"]) == (3, 0, 0)
    run = gepf.load(tracker.save(found, tmp_path / "run"))
    assert run.frame.tolist() == [0, 1, 2]
    assert np.array_equal(run.time_s, [frame.time_s for frame in frames])


def test_an_iteration_that_is_left_can_be_gone_on_with(endpoint: str) -> None:
    """A `break` ends the session; another iteration listens anew.

    One image may be sent to the ended session, if the publisher has not noticed its end.
    """
    (first,) = shown("standing").frames[0].views
    steps = ({KEY: message} for message in [*[encode_live(first)] * 4, b"rubbish", END])
    done, patience = threading.Semaphore(0), iter([60.0])
    with publishing(endpoint, [KEY], steps, lambda _: done.acquire(timeout=next(patience, 2.0))):
        live = gepf.live(KEY, listen=endpoint, idle_timeout=60.0)
        for _ in live:
            break
        assert live.counts["received"] == 1
        done.release()
        for _ in live:
            done.release(10)
    assert live.counts["received"] in {3, 4}
    assert live.counts["malformed"] == 1


def test_silence_and_close_end_the_iteration(endpoint: str) -> None:
    """Without a publisher: after the timeout, or by `close` from another thread."""
    assert list(gepf.live(KEY, listen=endpoint, idle_timeout=0.2)) == []
    with gepf.live(KEY, listen=endpoint) as live:
        threading.Timer(0.2, live.close).start()
        assert list(live) == []


def test_the_example_runs(endpoint: str, tmp_path: Path) -> None:
    """As users run it, before `gepf publish`: frames are tracked, including the last one."""
    write_small_sequence(tmp_path / "seq", 6)
    example = (sys.executable, "-m", "examples.live_tracking")
    tracking = [*example, KEY, endpoint, str(tmp_path / "seq" / "init.json")]
    play = ("publish", str(tmp_path / "seq"), "--key", KEY, "--connect", endpoint, "--rate", "30")
    with subprocess.Popen(tracking, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        publisher = start(gepf_command, *play, log=tmp_path / "publisher.log")
        lines = process.communicate(timeout=300.0)[0].splitlines()
        publisher.join(300.0)
    assert publisher.exitcode == 0
    assert re.match(r"frame \d tracked: ", lines[0])  # the newest that came; on a busy machine not frame 0
    assert lines[-2].startswith("frame 5 ")
    assert lines[-1].endswith(" of 6 frames were skipped")
