"""A worker leaves a link without anything at its other end, and no other."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from common.errors import BusError
from common.protocol import keys
from common.transport.opening import open_coordinator, open_router, open_worker
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.programs import INSTANT, started, wait_until
from tests.support.processes.serving import expected, pool, refined_bytes, running
from worker.service import Service, Task


@pytest.mark.slow
def test_a_worker_leaves_a_coordinator_without_a_run_for_the_next_coordinator(endpoint: str) -> None:
    """One that listens without ever starting a run; then another one listens."""
    place = Path(endpoint.partition("/")[2])
    gone, there = place.with_name("gone"), place.with_name("there")
    with open_coordinator([f"unixsock-stream/{gone}"]) as silent:
        place.symlink_to(gone)
        with started("--connect", endpoint, command=INSTANT):
            wait_until(lambda: silent.is_linked(within=0.0))
            place.unlink()
            place.symlink_to(there)
            with pool(f"unixsock-stream/{there}") as refiner:
                assert refined_bytes(refiner, 1) == expected(1)


@pytest.mark.parametrize("open_end", [open_router, pool])
def test_a_worker_stays_at_a_router_and_with_a_run(
    open_end: Callable[[Any], Any], endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a router there need not be a run; a coordinator answers, though it sends no requests."""
    monkeypatch.setattr("worker.service.SILENCE_S", 0.1)
    with (
        open_end([endpoint] if open_end is open_router else endpoint),
        open_worker([endpoint]) as own,
        running(Service(own, "w", KERNEL)) as service,
    ):
        assert own.meets_coordinator() == (open_end is pool)
        time.sleep(2.0)
        assert not service.abandoned


def test_a_worker_leaves_a_run_that_is_announced_and_does_not_answer(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A token may outlive its run, where the link does."""
    monkeypatch.setattr("worker.service.SILENCE_S", 0.1)
    with open_coordinator([endpoint]) as silent, open_worker([endpoint]) as own:
        silent.announce(keys.of_run("r", "alive"))
        service = Service(own, "w", KERNEL)
        service.run()
        assert service.abandoned


@pytest.mark.timeout(60)
def test_a_worker_whose_spare_requests_fail_on_the_bus_ends_with_the_error(endpoint: str) -> None:
    """As it does for other requests: it can be started again, but must not go on without serving searches."""

    def fail() -> None:
        raise BusError("the link is broken")

    with open_coordinator([endpoint]), open_worker([endpoint]) as own:
        service = Service(own, "w", KERNEL)
        service._spare_tasks.put(Task("r", fail))
        with pytest.raises(BusError, match="the link is broken"):
            service.run()
