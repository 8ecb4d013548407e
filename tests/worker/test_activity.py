"""What a worker shows of itself on a terminal."""

from __future__ import annotations

import io
import time

from worker.activity import Activity, StatusLine


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        """It is one."""
        return True


def test_the_line_counts_lanes_runs_and_particles() -> None:
    """Particles a second are those since the last look; a run that has not asked for long is gone."""
    now = [10.0]
    activity = Activity(4, lambda: now[0])
    assert activity.line() == "4 lanes, waiting for work"
    activity.refined("a", 30)
    activity.refined("b", 10)
    now[0] += 2.0
    assert activity.line() == "4 lanes, 2 runs served, 20 particles/s"
    now[0] += 4.0
    activity.refined("a", 8)
    assert activity.line() == "4 lanes, 1 run served, 2 particles/s"
    now[0] += 60.0
    assert Activity(1, lambda: now[0]).line() == "1 lane, waiting for work"
    assert activity.line() == "4 lanes, waiting for work"


def test_a_terminal_sees_it_and_a_log_does_not() -> None:
    """On a terminal the line renews itself and is taken away at the end; elsewhere it is not there."""
    terminal, log, quiet = Terminal(), io.StringIO(), Terminal()
    with (
        StatusLine(lambda: "working", terminal),
        StatusLine(lambda: "working", log),
        StatusLine(lambda: "working", quiet, quiet=True),
    ):
        until = time.monotonic() + 60.0
        while "working" not in terminal.getvalue() and time.monotonic() < until:
            time.sleep(0.05)
    assert terminal.getvalue().startswith("\r\x1b[Kworking")
    assert terminal.getvalue().endswith("\r\x1b[K")
    assert log.getvalue() == ""
    assert quiet.getvalue() == ""
