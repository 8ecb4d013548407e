"""What a person sees of a run, on a terminal and in a log."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from coordinator.commands.progress import FrameMeter, Show, counted, describe
from coordinator.tracking.estimate import Estimate


def estimate(residual: float = 0.0123) -> Estimate:
    """Three hypotheses, tracked."""
    poses = np.zeros((3, 1))
    return Estimate(0, 0.0, "tracked", poses[0], np.zeros((1, 3)), poses, np.full(3, 1 / 3), residual, {})


def test_a_frame_is_described_in_one_line() -> None:
    """Rate, hypotheses, residual in millimetres, status; and that nothing was seen."""
    assert describe(estimate(), 7.25) == "7.2 frames/s, 3 hypotheses, residual 12.3 mm, tracked"
    assert "residual nothing seen" in describe(estimate(float("nan")), 1.0)
    assert describe(estimate(), None) == "3 hypotheses, residual 12.3 mm, tracked"
    assert [counted(count, "frame") for count in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]


def test_the_rate_does_not_count_what_comes_before_the_first_frame() -> None:
    """Starting workers takes seconds and says nothing about tracking."""
    now = iter([0.0, 10.0, 60.0, 60.5, 61.0])
    with FrameMeter(3, clock=lambda: next(now)) as meter:
        for _ in range(3):
            meter.advance(estimate())
    assert meter.rate == pytest.approx(2.0)
    assert meter.seconds == pytest.approx(51.0)


def test_a_terminal_shows_a_bar_and_lines_above_it() -> None:
    """The bar ends with the last state; what is said in between is not lost."""
    screen = io.StringIO()
    show = Show(Console(file=screen, force_terminal=True, width=120))
    with show.frames(2) as meter:
        show.say("worker [a] joined")
        meter.advance(estimate())
        meter.advance(estimate())
    assert "worker [a] joined\n" in screen.getvalue()
    assert "2/2" in screen.getvalue()
    assert "3 hypotheses" in screen.getvalue()


def test_a_log_gets_lines_now_and_then_and_the_last_state() -> None:
    """No control characters; one line for frames that come fast, one more for each few seconds."""
    log = io.StringIO()
    show = Show(Console(file=log, force_terminal=False, width=40))
    with show.frames(9) as meter, show.steps("counting") as advance:
        for done in range(1, 10):
            meter.advance(estimate())
            advance(done, 9)
    lines = log.getvalue().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("frame 9 of 9: ")
    show = Show(Console(file=log, force_terminal=False, width=40), quiet_seconds=0.0)
    with show.frames(2) as meter, show.steps("counting") as advance:
        meter.advance(estimate())
        advance(1, 2)
        meter.advance(estimate())
    assert [line.split(":")[0] for line in log.getvalue().splitlines()[1:]] == [
        "frame 1 of 2",
        "counting",
        "frame 2 of 2",
    ]
    assert "\x1b" not in log.getvalue()


def test_of_the_first_frame_alone_no_rate_is_told() -> None:
    """It took as long as workers needed to start."""
    log = io.StringIO()
    show = Show(Console(file=log, force_terminal=False, width=40), quiet_seconds=0.0)
    with show.frames(2) as meter:
        meter.advance(estimate())
        meter.advance(estimate())
    first, second = log.getvalue().splitlines()
    assert "frames/s" not in first
    assert "frames/s" in second
