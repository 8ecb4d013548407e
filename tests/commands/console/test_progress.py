"""What people see of a run, on a terminal and in a log."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from gepf.coordinator.commands.progress import FrameRate, Show, counted, describe_frame
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.estimate import Estimate


def estimate(residual: float = 0.0123) -> Estimate:
    """Three hypotheses, tracked."""
    poses, weights = np.zeros((3, 1)), np.full(3, 1 / 3)
    return Estimate(
        0, 0.0, "tracked", poses[0], np.zeros((1, 3)), poses, weights, residual, unknown_certainty(1)
    )


def test_a_frame_is_described_in_one_line() -> None:
    """Rate, hypotheses, residual in millimetres, status; and that nothing was seen."""
    assert describe_frame(estimate(), 7.25) == "7.2 frames/s, 3 hypotheses, residual 12.3 mm, tracked"
    assert "residual nothing seen" in describe_frame(estimate(float("nan")), 1.0)
    assert describe_frame(estimate(), 7.25, 0.034).startswith("7.2 frames/s, latency 34 ms, 3 hypotheses")
    assert describe_frame(estimate(), None) == "3 hypotheses, residual 12.3 mm, tracked"
    unknown = replace(estimate(), status="absent", hypothesis_weight=np.empty(0))
    assert describe_frame(unknown, None) == "waiting for a person to enter the image"
    assert describe_frame(replace(unknown, status="searching"), None, noun="body") == "looking for the body"
    assert [counted(count, "frame") for count in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]


def test_the_rate_does_not_count_what_comes_before_the_first_frame() -> None:
    """Starting workers takes seconds and is no part of tracking; a first frame alone has no rate."""
    now = iter([0.0, 60.0, 60.5, 61.0])
    rate, rates = FrameRate(clock=lambda: next(now)), []
    for _ in range(3):
        rate.count()
        rates.append(rate.per_second)
    assert rates == [None, pytest.approx(2.0), pytest.approx(2.0)]
    assert rate.seconds == pytest.approx(61.0)


def test_the_rate_of_received_frames_is_that_of_the_last_second() -> None:
    """And so is the latency, from reception to result."""
    now = iter([0.0, 5.0, 7.0, 7.5, 8.0])
    rate = FrameRate(clock=lambda: next(now))
    for received in (0.0, 6.9, 7.2, 7.9):
        rate.count(received)
    assert rate.latest_per_second == pytest.approx(2.0)
    assert rate.latency_s == pytest.approx(0.1)


def test_a_terminal_shows_a_bar_and_lines_above_it() -> None:
    """The bar ends with the last state; messages in between are kept."""
    screen = io.StringIO()
    show = Show(Console(file=screen, force_terminal=True, width=120))
    with show.steps("frame", keep=True) as advance:
        show.say("worker [a] joined")
        advance(2, 2, "3 hypotheses")
    assert "worker [a] joined\n" in screen.getvalue()
    assert "2/2" in screen.getvalue()
    assert "3 hypotheses" in screen.getvalue()


@pytest.mark.parametrize(("quiet_seconds", "frames"), [(60.0, [9]), (0.0, [*range(1, 10)])])
def test_a_log_gets_lines_now_and_then_and_the_last_state(quiet_seconds: float, frames: list[int]) -> None:
    """No control characters; lines at the given interval; a progress that is not kept has no last line."""
    log = io.StringIO()
    show = Show(Console(file=log, force_terminal=False, width=40), quiet_seconds)
    with show.steps("frame", keep=True) as advance:
        for done in range(1, 10):
            advance(done, 9, "tracked")
    assert log.getvalue().splitlines() == [f"frame {done} of 9: tracked" for done in frames]
    with Show(Console(file=log, force_terminal=False), quiet_seconds=60.0).steps("rendering") as advance:
        advance(1, 2)
    assert "rendering" not in log.getvalue()
