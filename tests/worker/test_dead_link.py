"""A worker leaves a link at whose end nobody is, and no other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest

from common.protocol import keys
from common.transport.bus import Bus
from common.transport.opening import open_coordinator, open_router, open_worker
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.programs import INSTANT, started, wait_until
from tests.support.processes.serving import expected, pool, refined_bytes, running
from worker.connection import ASKED_S, MOST_IN_VAIN, DeadLink
from worker.service import Service


def test_a_worker_leaves_who_has_no_run_for_the_next_coordinator(endpoint: str) -> None:
    """One that listens, and stays for ever without a run, as a closing one may; then another is there."""
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
    monkeypatch.setattr("worker.connection.ASKED_S", 0.1)
    with (
        open_end([endpoint] if open_end is open_router else endpoint),
        open_worker([endpoint]) as own,
        running(Service(own, "w", KERNEL)) as service,
    ):
        assert own.meets_coordinator() == (open_end is pool)
        time.sleep(3.0)
        assert not service.abandoned


def test_a_worker_leaves_a_run_that_is_announced_and_does_not_answer(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A token may outlive its run, where the link does."""
    monkeypatch.setattr("worker.connection.ASKED_S", 0.1)
    with open_coordinator([endpoint]) as silent, open_worker([endpoint]) as own:
        silent.announce(keys.run_alive("r"))
        service = Service(own, "w", KERNEL)
        service.run()
        assert service.abandoned


@dataclass
class Far:
    """The other end of a link: whether there is a coordinator, and whether its run answers."""

    coordinator: bool = True
    answers: bool = False

    def meets_coordinator(self) -> bool:
        """As it is set."""
        return self.coordinator

    def fetch(self, *_: object) -> bytes | None:
        """Nothing more than that somebody is there."""
        return b"" if self.answers else None


def test_a_link_is_dead_when_it_is_asked_in_vain_many_times() -> None:
    """In a row: a request, an answer, or no coordinator at all, and the count begins anew."""
    now, far = 0.0, Far()
    link = DeadLink(cast("Bus", far), lambda: now)

    def asked(times: int) -> bool:
        nonlocal now
        found = False
        for _ in range(times):
            assert not found
            now += ASKED_S
            found = link.is_found()
        return found

    assert not asked(MOST_IN_VAIN)
    link.hear()
    assert not asked(MOST_IN_VAIN)
    far.answers = True
    assert not asked(1)
    far.answers = False
    assert not asked(MOST_IN_VAIN)
    far.coordinator = False
    assert not asked(2 * MOST_IN_VAIN)
    far.coordinator = True
    assert not asked(MOST_IN_VAIN)
    assert asked(1)
