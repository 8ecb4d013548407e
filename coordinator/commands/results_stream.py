"""Results that `gepf track` publishes while it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

from common.errors import InputError, SilentWorkers
from common.protocol.keys import check_stream
from coordinator.commands.options.job import Job
from coordinator.results.live_results import LiveResults, Outlet
from coordinator.tracking.refiner import Refiner


@runtime_checkable
class Speaking(Protocol):
    """A refiner on a bus where others listen."""

    def speak(self, key: str) -> Outlet:
        """Where to put what others are to hear on a key."""
        ...


def check_results(job: Job) -> None:
    """InputError for a key that cannot be used, or that nobody could listen to."""
    if job.results is None:
        if job.results_json:
            raise InputError("--publish-json says how results are published; add --publish KEY")
        return
    if job.pool.listen is None and job.pool.connect is None:
        raise InputError("nobody could hear the results; add --listen or --connect with an endpoint")
    check_stream(job.results, guarded=job.pool.security is not None)


@contextmanager
def open_results(job: Job, refiner: Refiner, *, again: bool = False) -> Iterator[LiveResults | None]:
    """Where estimates are published, None if nobody asked; its end is published, too.

    again: Whether the run connects anew where all workers fall silent, so that this is not the end.
    """
    if job.results is None or not isinstance(refiner, Speaking):
        yield None
        return
    results, goes_on = LiveResults(refiner.speak(job.results), as_json=job.results_json), False
    try:
        yield results
    except SilentWorkers:
        goes_on = again
        raise
    finally:
        if not goes_on:
            results.end()
