"""What a person sees on stderr while a run goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from coordinator.commands.console import INTERRUPTS

if TYPE_CHECKING:
    from coordinator.tracking.estimate import Estimate

QUIET_S = 5.0  # between two lines where there is no terminal

Advance = Callable[[int, int], None]
"""Reports how many are done, and of how many."""


class Show:
    """Reports a run's progress on a console: as bars on a terminal, elsewhere as lines, for logs.

    Lines of progress are at least `quiet_seconds` apart.
    """

    def __init__(self, console: Console, quiet_seconds: float = QUIET_S) -> None:
        self.console, self.quiet_seconds = console, quiet_seconds

    def say(self, text: str) -> None:
        """One line, above a bar if there is one."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def warn(self, text: str) -> None:
        """One line that must not be missed."""
        self.console.print(text, style="bold red", highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def steps(self, text: str) -> Iterator[Advance]:
        """A count of something that takes a while; a bar goes away at the end."""
        last = time.monotonic()
        with make_bar(self.console, transient=True) as bar:
            task = bar.add_task(text, total=None)

            def advance(done: int, total: int) -> None:
                nonlocal last
                INTERRUPTS.check()
                bar.update(task, completed=done, total=total)
                if not self.console.is_terminal and time.monotonic() - last > self.quiet_seconds:
                    last = time.monotonic()
                    self.say(f"{text}: {done} of {total}")

            yield advance

    def frames(self, total: int | None, done: int = 0) -> FrameMeter:
        """A meter for the frames of a run, None if their number is unknown; a context manager.

        Some of them may be done before.
        """
        return FrameMeter(total, done, self)


class FrameMeter:
    """Frame rate, hypotheses, residual and status, frame by frame; silent without a `show`."""

    def __init__(
        self,
        total: int | None,
        done: int = 0,
        show: Show | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.total = total
        self.done = self._before = done
        self._clock = clock
        self._began = self._first = self._last = clock()
        self._show, self._text, self._shown = show, "", time.monotonic()
        self._bar = make_bar(show.console if show else Console(quiet=True), transient=False)
        self._task = self._bar.add_task("starting", total=total, completed=done)

    def __enter__(self) -> Self:
        self._began = self._clock()
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def seconds(self) -> float:
        """From the start to the last frame."""
        return self._last - self._began

    @property
    def rate(self) -> float:
        """Frames per second; the first, for which workers start, does not count if there are others."""
        done = self.done - self._before
        if done > 1:
            return (done - 1) / max(self._last - self._first, 1e-9)
        return done / max(self.seconds, 1e-9)

    def advance(self, estimate: Estimate, note: str = "") -> None:
        """One frame more, and what else there is to say."""
        self.done += 1
        self._last = self._clock()
        if self.done == self._before + 1:
            self._first = self._last
        rate = self.rate if self.done > self._before + 1 else None
        self.show(describe(estimate, rate) + note)

    def show(self, text: str) -> None:
        """Move the bar, or write a line if there was none for a while."""
        self._bar.update(self._task, completed=self.done, description=text)
        of_total = "" if self.total is None else f" of {self.total}"
        self._text = f"frame {self.done}{of_total}: {text}"
        if self._show is not None and time.monotonic() - self._shown > self._show.quiet_seconds:
            self._write(self._show)

    def close(self) -> None:
        """Leave the bar as it stands; write the last state, unless it was written."""
        self._bar.stop()
        if self._show is not None:
            self._write(self._show)

    def _write(self, show: Show) -> None:
        if self._text and not show.console.is_terminal:
            show.say(self._text)
        self._text, self._shown = "", time.monotonic()


def describe(estimate: Estimate, rate: float | None) -> str:
    """A frame's state in one short line: rate, hypotheses, how well the likeliest fits, status."""
    how_fast = "" if rate is None else f"{rate:.1f} frames/s, "
    count = len(estimate.hypothesis_weight)
    if not count:
        return how_fast + describe_waiting(estimate)
    residual = "nothing seen" if math.isnan(estimate.residual) else f"{1000 * estimate.residual:.1f} mm"
    why = f" ({estimate.why})" if estimate.why and estimate.status != "tracked" else ""
    hypotheses = counted(count, "hypothesis", "hypotheses")
    return f"{how_fast}{hypotheses}, residual {residual}, {estimate.status}{why}"


def counted(count: int, one: str, several: str = "") -> str:
    """A number with its noun."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def describe_waiting(estimate: Estimate) -> str:
    """What a run waits for before a person is found."""
    if estimate.status == "absent":
        return "waiting for a person to come into the picture"
    return f"looking for the person{f': {estimate.why}' if estimate.why else ''}"


def make_bar(console: Console, *, transient: bool) -> Progress:
    """A bar with counts, a text, and the time that is left; shown on a terminal only."""
    columns = (BarColumn(bar_width=16), MofNCompleteColumn(), TextColumn("{task.description}"))
    return Progress(
        *columns,
        TimeRemainingColumn(),
        console=console,
        transient=transient,
        disable=console.quiet or not console.is_terminal,
    )
