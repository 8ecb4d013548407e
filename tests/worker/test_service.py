"""A worker leaves a link without anything at its other end, and no other; its health check."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gepf.common.errors import BusError, ProtocolError
from gepf.common.protocol import keys
from gepf.common.protocol.frames import encode_frame
from gepf.common.protocol.messages import RefineRequest
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.common.transport.channels import IncomingRequest
from gepf.common.transport.opening import open_coordinator, open_router, open_worker
from gepf.worker.connection import Identity, check_alive
from gepf.worker.memory import Memory
from gepf.worker.service import Service, Task
from gepf.worker.warm_up import tiny_frame
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.programs import INSTANT, started, wait_until
from tests.support.processes.serving import (
    PARTICLES,
    REQUEST,
    expected,
    pool,
    refined_bytes,
    running,
    serving,
)


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
    monkeypatch.setattr("gepf.worker.service.SILENCE_S", 0.1)
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
    monkeypatch.setattr("gepf.worker.service.SILENCE_S", 0.1)
    with open_coordinator([endpoint]) as silent, open_worker([endpoint]) as own:
        silent.announce(keys.of_run("room/r", "alive"))
        service = Service(own, "w", KERNEL)
        service.run()
        assert service.abandoned


@pytest.mark.timeout(300)
def test_a_request_does_not_wait_for_a_search_that_observes_the_same_frame(endpoint: str) -> None:
    """The thread of a search has low priority, so it may take long; another search waits for it."""
    begun, let, seen = threading.Event(), threading.Event(), list[str]()

    def observe(*_: object) -> object:
        seen.append(threading.current_thread().name)
        if len(seen) == 1:
            begun.set()
            let.wait()
        return object()

    def asked(*, spare: bool) -> RefineRequest:
        return replace(REQUEST, particles=Particles(np.zeros((1, 6)), RefineSettings(), spare=spare))

    with (
        open_coordinator([endpoint]) as there,
        open_worker([endpoint]) as bus,
        ThreadPoolExecutor(2, "search") as threads,
    ):
        there.serve(keys.of_run(REQUEST.run, "frame/*"), lambda _: encode_frame(tiny_frame()))
        memory = Memory(bus, observe)
        searches = [threads.submit(memory.observation, asked(spare=True))]
        begun.wait()
        searches.append(threads.submit(memory.observation, asked(spare=True)))
        time.sleep(0.2)  # the second one waits by then
        assert memory.observation(asked(spare=False)) is not None
        let.set()
        assert all(each.result() is not None for each in searches)
    assert [name.partition("_")[0] for name in seen] == ["search", "MainThread"]


@pytest.mark.timeout(300)
def test_a_worker_whose_spare_requests_fail_on_the_bus_ends_with_the_error(endpoint: str) -> None:
    """As it does for other requests: it can be started again, but must not go on without serving searches."""

    def fail(_: bytes) -> None:
        raise BusError("the link is broken")

    spare = replace(REQUEST, particles=replace(PARTICLES, spare=True))
    with open_coordinator([endpoint]), open_worker([endpoint]) as own:
        service = Service(own, "w", KERNEL)
        request = cast("IncomingRequest", SimpleNamespace(refuse=fail))
        service._turns.put(spare.run, Task(spare, request), spare=True)
        with pytest.raises(BusError, match="the link is broken"):
            service.run()


def test_a_request_that_cannot_be_read_for_any_reason_is_refused(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error of the worker's own is said at once; nobody waits for a request that got lost."""

    def fail(_: bytes) -> RefineRequest:
        raise TypeError("a fault")

    monkeypatch.setattr("gepf.worker.service.decode_request", fail)
    with (
        pool(endpoint) as refiner,
        open_worker([endpoint]) as own,
        running(Service(own, "w", KERNEL)),
        pytest.raises(ProtocolError, match="could not read the request: TypeError: a fault"),
    ):
        refined_bytes(refiner, 1)


def test_a_worker_is_healthy_as_long_as_it_is_announced(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is seen while it is at work, under its own name only, and no more once it has ended."""
    with open_coordinator([endpoint]):
        with serving(endpoint, "w"):
            check_alive(Identity("w", (endpoint,)))
            monkeypatch.setattr("gepf.common.transport.admission.SEEN_WITHIN_S", 0.5)
            with pytest.raises(BusError, match="worker 'v' is not seen at unixsock"):
                check_alive(Identity("v", (endpoint,)))
        with pytest.raises(BusError, match="'w' is not seen"):
            check_alive(Identity("w", (endpoint,)))


@pytest.mark.slow
def test_the_command_says_so_by_its_exit_code(endpoint: str) -> None:
    """`gepf-worker --check` for a worker that is not there: 1 and one line."""
    command = [sys.executable, "-m", "gepf.worker.cli", "--connect", endpoint, "--name", "v", "--check"]
    with open_coordinator([endpoint]):
        done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)
    assert (done.returncode, done.stderr) == (1, f"gepf-worker: worker 'v' is not seen at {endpoint}\n")
