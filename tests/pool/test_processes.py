"""Workers as real processes that are killed, frozen, and left without a coordinator."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]
import pytest

from gepf.common.body import BodyModel
from gepf.common.errors import BusError
from gepf.common.kernel import Kernel
from gepf.common.protocol import keys
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.pool.local_worker import LocalWorkerLimits
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.tracking.warm_up import unmoved
from gepf.worker.cli import exit_with, serve
from gepf.worker.connection import Identity
from tests.support.processes import warm_processes as warm
from tests.support.processes.instant_worker import DISTURBANCES, disturb
from tests.support.processes.programs import INSTANT, is_alive, started, wait_until
from tests.support.processes.serving import MODEL, PARTICLES, expected, frame, pool, refined_bytes


def local(lanes: int, report: Callable[[str], None] = lambda _: None, **options: Any) -> ZenohRefiner:
    """A coordinator with a local worker of this number of lanes."""
    options = {"worker_command": INSTANT, **options}
    return ZenohRefiner(Pool(workers=lanes, **options), report)


def disturbed(folder: Path) -> tuple[str, ...]:
    """The command of a worker that signals itself when the folder says so."""
    return ("env", f"{DISTURBANCES}={folder}", *INSTANT)


@pytest.mark.parametrize(("lanes", "outside"), [(1, 0), (2, 3)])
def test_killed_worker_is_replaced(lanes: int, outside: int, endpoint: str, tmp_path: Path) -> None:
    """SIGKILL in the middle of a frame changes no byte; the worker is started again and serves."""
    said, command = list[str](), disturbed(tmp_path)
    with local(lanes, said.append, listen=endpoint, worker_command=command) as refiner, ExitStack() as stack:
        if outside:
            asked = ("--connect", endpoint, "--lanes", str(outside))
            stack.enter_context(warm.started(warm.work_instantly, *asked, log=tmp_path.with_suffix(".log")))
        refiner.wait_for(lanes + outside)
        assert refined_bytes(refiner, 0) == expected(0)
        name, pid = f"{keys.last_of(refiner.run)}-0", refiner.local_pid
        disturb(tmp_path, signal.SIGKILL)
        while any(tmp_path.iterdir()):
            assert refined_bytes(refiner, 1) == expected(1)
        wait_until(lambda: not is_alive(pid))
        refiner.wait_for(lanes + outside)
        for number in range(2, 5):
            assert refined_bytes(refiner, number) == expected(number)
        if outside:
            time.sleep(0.2)  # for the clock to be looked at
            refined_bytes(refiner, 5)
        assert refiner.statistics.counts["batches_sent_again"] > 0
        assert refiner.statistics.counts["local_workers_restarted"] == 1
    assert f"worker {name} was ended by SIGKILL; starting it again" in said


def test_a_frozen_worker_is_worked_around(endpoint: str, tmp_path: Path) -> None:
    """SIGSTOP in a frame changes no byte; the frame is done before the bus misses the worker."""
    said, command = list[str](), disturbed(tmp_path)
    with (
        local(1, said.append, listen=endpoint, worker_command=command) as refiner,
        warm.started(warm.work_instantly, "--connect", endpoint, log=tmp_path.with_suffix(".log")),
    ):
        refiner.wait_for(2)
        assert refined_bytes(refiner, 0) == expected(0)
        disturb(tmp_path, signal.SIGSTOP)
        try:
            while any(tmp_path.iterdir()):
                assert refined_bytes(refiner, 1) == expected(1)
            assert refined_bytes(refiner, 2) == expected(2)
            assert not any(line.endswith("left") for line in said)
            assert refiner.statistics.counts["batches_sent_again"] > 0
        finally:
            os.kill(refiner.local_pid, signal.SIGCONT)
        refiner.wait_for(2)
        assert refined_bytes(refiner, 3) == expected(3)


def test_the_only_worker_is_replaced_when_it_stays_frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the bus no longer sees it, it has some time and is then killed."""
    monkeypatch.setattr("gepf.coordinator.pool.local_worker.LIMITS", LocalWorkerLimits(absence_s=1.0))
    said: list[str] = []
    with local(1, said.append) as refiner:
        assert refined_bytes(refiner, 0) == expected(0)
        name, pid = f"{keys.last_of(refiner.run)}-0", refiner.local_pid
        os.kill(pid, signal.SIGSTOP)
        assert refined_bytes(refiner, 1) == expected(1)
        assert not is_alive(pid)
        assert refiner.statistics.counts["local_workers_restarted"] == 1
    assert f"worker {name} was ended by SIGKILL; starting it again" in said


def test_frozen_worker_is_ended_with_the_run() -> None:
    """A worker that does not listen to the end of the run is killed."""
    with local(1) as refiner:
        refiner.wait_for(1)
        pid = refiner.local_pid
        os.kill(pid, signal.SIGSTOP)
    assert not is_alive(pid)


def test_workers_that_do_not_start() -> None:
    """If a worker cannot start, the run ends with its last line."""
    command = (sys.executable, "-c", "raise SystemExit('no such kernel')")
    why = pytest.raises(BusError, match=r"local workers do not start; .* exit code 1: no such kernel")
    with local(1, worker_command=command) as refiner, why:
        refiner.wait_for(1)


COORDINATOR = """
import time
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.processes.programs import INSTANT
with ZenohRefiner(Pool(workers=2, worker_command=INSTANT)) as refiner:
    refiner.wait_for(2)
    print(refiner.local_pid, flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_their_coordinator(number: signal.Signals, tmp_path: Path) -> None:
    """However the coordinator ends, its own workers do not outlive it."""
    with subprocess.Popen(
        [sys.executable, "-c", COORDINATOR],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as process:
        assert process.stdout is not None
        pids = [int(pid) for pid in process.stdout.readline().split()]
        assert len(pids) == 1
        process.send_signal(number)
        assert process.wait(300.0) != 0
    wait_until(lambda: not any(is_alive(pid) for pid in pids))


def test_outside_worker_serves_until_a_signal(endpoint: str) -> None:
    """A `gepf-worker` started before its coordinator connects, serves, reports it, and ends with 0."""
    with started("--connect", endpoint, "--name", "outside", "--lanes", "2") as process:
        with pool(endpoint) as refiner:
            refiner.wait_for(1)
            refined = refiner.submit(frame(1), MODEL, PARTICLES).result()
            assert refined.poses.shape == PARTICLES.poses.shape
            assert refiner.statistics.workers_seen == ("outside",)
            process.terminate()
            assert process.wait(300.0) == 0
        assert process.stderr is not None
        lines = process.stderr.read().splitlines()
        assert lines[1] == f"gepf-worker: connecting to {endpoint}"
        serves = f"gepf-worker: outside serves {endpoint} with 2 lanes (cpu, "
        assert sum(line.startswith(serves) for line in lines) == 1


def test_idle_worker_is_idle(endpoint: str, tmp_path: Path) -> None:
    """A worker without requests uses almost no processor time."""
    with (
        pool(endpoint) as refiner,
        warm.started(warm.work_instantly, "--connect", endpoint, log=tmp_path / "log") as process,
    ):
        refiner.wait_for(1)
        wait_until(
            lambda: psutil.Process(process.pid).cpu_percent(1.0) < 10.0
        )  # it may still be about what it loaded


def serve_without_hearing(endpoint: str, asked: Path) -> None:
    """`gepf-worker` with a kernel that swallows whatever a signal raises."""

    def refine(_model: BodyModel, _observation: object, particles: Particles) -> Refined:
        with suppress(BaseException):
            asked.touch()
            time.sleep(600.0)
        return unmoved(particles)

    identity = Identity("deaf", (endpoint,))
    exit_with(lambda: serve(identity, lambda: Kernel(lambda *_: None, refine)))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_worker_whose_signal_is_swallowed_ends_after_the_request(
    number: signal.Signals, tmp_path: Path
) -> None:
    """A library that hides exceptions does not keep it alive; the request is answered."""
    endpoint, asked = f"unixsock-stream/{tmp_path / 'bus'}", tmp_path / "asked"
    with pool(endpoint) as refiner:
        worker = warm.start(serve_without_hearing, endpoint, asked, log=tmp_path / "log")
        try:
            refiner.wait_for(1)
            pending = refiner.submit(frame(1), MODEL, PARTICLES)
            wait_until(asked.exists, 300.0)
            assert warm.end(worker, number) == 0
            assert np.array_equal(pending.result().poses, PARTICLES.poses)
        finally:
            worker.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_worker_that_is_still_connecting_can_be_ended(number: signal.Signals, tmp_path: Path) -> None:
    """A worker whose coordinator never comes does not hang at a signal; an interrupt may be an exit code."""
    with started("--connect", f"unixsock-stream/{tmp_path / 'nobody'}", command=INSTANT) as process:
        assert process.stderr is not None
        assert any("before connecting" in line for line in process.stderr)
        time.sleep(1.5)
        process.send_signal(number)
        assert process.wait(300.0) in {-number, 130 if number == signal.SIGINT else -number}
