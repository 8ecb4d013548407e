"""Threads that work side by side on one request; compiled code holds no lock, so they share it well."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue

from common.closing import Closing

Work = Callable[[int], None]
"""What a lane does; called with the lane's number."""


class Lanes(Closing):
    """A fixed number of lanes: the thread that calls, and threads of our own beside it.

    A context manager; the threads end with it. They are daemons, so that they never hold up an exit.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError("there must be a lane")
        self.count = count
        self._orders: list[SimpleQueue[Work | None]] = [SimpleQueue() for _ in range(count - 1)]
        self._ended: SimpleQueue[BaseException | None] = SimpleQueue()
        for lane, orders in enumerate(self._orders, start=1):
            threading.Thread(target=self._obey, args=(lane, orders), name=f"lane-{lane}", daemon=True).start()

    def close(self) -> None:
        """Have the threads end when they have done what they do."""
        for orders in self._orders:
            orders.put(None)

    def run(self, work: Work, lanes: int, stop: Callable[[], None]) -> None:
        """Call `work(lane)` on the first `lanes` lanes at once; return when the last of them has returned.

        What one of them raises is raised here when all have returned. `stop` is called by a lane that fails
        or is interrupted, so that the others return soon.
        """

        def attempt(lane: int) -> None:
            try:
                work(lane)
            except BaseException:
                stop()
                raise

        others = min(lanes, self.count) - 1
        for orders in self._orders[:others]:
            orders.put(attempt)
        failures = [caught(lambda: attempt(0)), *(self._await_one(stop) for _ in range(others))]
        for failure in failures:
            if failure is not None:
                raise failure

    def _await_one(self, stop: Callable[[], None]) -> BaseException | None:
        """Wait for a lane; give what it raised, or what interrupted the wait."""
        interrupt: BaseException | None = None
        while True:
            try:
                raised = self._ended.get()
            except BaseException as error:  # noqa: BLE001 - a signal; the lane is waited for all the same
                interrupt = error
                stop()
            else:
                return interrupt or raised

    def _obey(self, lane: int, orders: SimpleQueue[Work | None]) -> None:
        while (work := orders.get()) is not None:
            self._ended.put(caught(partial(work, lane)))


def caught(call: Callable[[], None]) -> BaseException | None:
    """What a call raises, None if nothing."""
    try:
        call()
    except BaseException as error:  # noqa: BLE001 - a signal, too; who asked raises it again
        return error
    return None
