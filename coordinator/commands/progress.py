"""Progress of a run on stderr."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from typing import TYPE_CHECKING, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from gepf.coordinator.commands.console import INTERRUPTS
from gepf.coordinator.notices import NOTICE_S

if TYPE_CHECKING:
    from gepf.coordinator.tracking.estimate import Estimate


class Advance(Protocol):
    """A progress bar or line."""

    def __call__(self, done: int, total: int | None, detail: str = "") -> None:
        """Show the number of steps done, the total if known, and a state."""
        ...


class Show:
    """Reports the progress of a run: as bars on a terminal, otherwise as lines for logs.

    Each line starts with `name`. Lines of progress are at least `quiet_seconds` apart.
    """

    def __init__(self, console: Console, quiet_seconds: float = NOTICE_S, name: str = "") -> None:
        self.console, self._quiet_seconds, self._name = console, quiet_seconds, name

    def say(self, text: str, style: str | None = None) -> None:
        """Print one line, above the bar if there is one."""
        self.console.print(self._name + text, style=style, highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def steps(
        self, label: str, done: int = 0, total: int | None = None, *, keep: bool = False
    ) -> Iterator[Advance]:
        """Count the steps of a long task. With `keep` the last state stays visible.

        An interrupt that a library suppressed is raised again at the next step.
        """
        on_terminal, line, written = self.console.is_terminal, "", time.monotonic()
        bar = bars_on(self.console, keep=keep)
        task = bar.add_task(label, completed=done, total=total)

        def advance(done: int, total: int | None, detail: str = "") -> None:
            nonlocal line, written
            INTERRUPTS.check()
            bar.update(task, completed=done, total=total, description=detail or label)
            line = f"{label} {done}" + ("" if total is None else f" of {total}") + (detail and f": {detail}")
            if not on_terminal and time.monotonic() - written > self._quiet_seconds:
                self.say(line)
                line, written = "", time.monotonic()

        try:
            with bar:
                yield advance
        finally:
            if keep and line and not on_terminal:
                self.say(line)


def bars_on(console: Console, *, keep: bool = False, hidden: bool = False) -> Progress:
    """Progress bars on a terminal, unless they are `hidden`; with `keep` their last state stays visible."""
    columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TextColumn("{task.description}"))
    off = hidden or console.quiet or not console.is_terminal
    return Progress(*columns, TimeRemainingColumn(), console=console, transient=not keep, disable=off)


class FrameRate:
    """Counts tracked frames and their time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._frames = clock, 0
        self._began = self._first = self._last = clock()
        self._latest = deque[tuple[float, float]]()  # times of the last second, and latency of these frames

    def count(self, received_at: float | None = None) -> None:
        """Count one frame; with `received_at`, a time of the same clock, also note its latency."""
        self._frames, self._last = self._frames + 1, self._clock()
        if self._frames == 1:
            self._first = self._last
        if received_at is not None:
            self._latest.append((self._last, self._last - received_at))
        while len(self._latest) > 2 and self._latest[0][0] < self._last - 1.0:
            self._latest.popleft()

    @property
    def seconds(self) -> float:
        """Seconds from the start to the last frame."""
        return self._last - self._began

    @property
    def per_second(self) -> float | None:
        """Frames per second, without the first frame, during which workers start; None until the second."""
        return (self._frames - 1) / max(self._last - self._first, 1e-9) if self._frames > 1 else None

    @property
    def latest_per_second(self) -> float | None:
        """Received frames per second in the last second; None if not known."""
        spent = self._last - self._latest[0][0] if self._latest else 0.0
        return (len(self._latest) - 1) / spent if spent else None

    @property
    def latency_s(self) -> float | None:
        """Median time from the reception of a frame to its count, in the last second; None if not known."""
        return median(late for _, late in self._latest) if self._latest else None


def describe_frame(
    estimate: Estimate, rate: float | None, latency_s: float | None = None, noun: str = "person"
) -> str:
    """The state of a frame in a short line: rate, hypotheses, residual of the most likely, status.

    `noun` is what the body is called.
    """
    how_fast = "" if rate is None else f"{rate:.1f} frames/s, "
    how_fast += "" if latency_s is None else f"latency {1000 * latency_s:.0f} ms, "
    why = f" ({estimate.why})" if estimate.why and estimate.status != "tracked" else ""
    count = len(estimate.hypothesis_weight)
    if not count:
        waiting = f"waiting for a {noun} to enter the image" if estimate.status == "absent" else None
        return how_fast + (waiting or f"looking for the {noun}{why}")
    faulty = "".join(f"; camera {name} {kind}" for name, (kind, _) in estimate.faults.items())
    residual = "nothing seen" if math.isnan(estimate.residual) else f"{1000 * estimate.residual:.1f} mm"
    hypotheses = counted(count, "hypothesis", "hypotheses")
    return f"{how_fast}{hypotheses}, residual {residual}, {estimate.status}{why}{faulty}"


def counted(count: int, one: str, several: str = "") -> str:
    """A number with its noun."""
    return f"{count} {one if count == 1 else several or one + 's'}"
