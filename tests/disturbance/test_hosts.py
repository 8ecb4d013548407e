"""Coordinator, router and three workers, each a network host of its own, on a network that fails."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest

from tests.support.processes.network import Network, NotAllowed
from tests.support.processes.place import Place, recorded
from tests.support.processes.warm_processes import coordinate, gepf

pytestmark = pytest.mark.slow

FRAMES = 80
BUSY = 0.1  # seconds that a worker takes over a batch at least, so that the run lasts
WORKERS = ("w0", "w1", "w2")
PATIENCE = 180.0  # seconds for whatever must happen, on a busy machine, too
PORT = 7447
DONE = "a batch is done"


def work_slowly(endpoint: str, name: str) -> None:
    """`gepf-worker`, with a long task in each batch; says when it has done one."""
    from gepf.common.kernel import Kernel
    from gepf.worker.cli import exit_with, serve
    from gepf.worker.connection import Identity
    from tests.support.kernel.warm_kernel import KERNEL

    def refine(*asked: Any, **how: Any) -> Any:
        time.sleep(BUSY)
        refined = KERNEL.refine(*asked, **how)
        sys.stderr.write(f"{DONE}\n")
        return refined

    exit_with(lambda: serve(Identity(name, (endpoint,)), lambda: Kernel(KERNEL.observe, refine)))


class Site:
    """Processes on hosts of their own, and the run that they are at."""

    def __init__(self, network: Network, sequence: Path, folder: Path) -> None:
        self.network = network
        self.sequence = sequence
        self.folder = folder
        self.run = folder / "run"
        self.hosts = {name: network.host(name) for name in ("coordinator", "router", *WORKERS)}
        self.endpoint = f"tcp/{self.hosts['router'].address}:{PORT}"
        self.processes: dict[str, BaseProcess] = {}

    def start_router(self) -> None:
        """Let all meet."""
        self._start("router", gepf, "router", "--listen", self.endpoint, "--insecure")

    def start_all(self) -> None:
        """The router, the workers and the run; returns when frames are recorded and all workers take part."""
        self.start_router()
        for name in WORKERS:
            self._start(name, work_slowly, self.endpoint, name)
        own = f"unixsock-stream/{self.folder}/bus"  # where nobody connects
        self._start(
            "coordinator", coordinate, self.sequence, self.run, own, "--connect", self.endpoint, "--insecure"
        )
        self.await_answers(WORKERS)
        self.await_progress()

    def end(self, name: str) -> None:
        """End a process, at once."""
        process = self.processes.pop(name)
        process.kill()
        process.join()

    def count(self, who: str, line: str) -> int:
        """How often a line is in the log of a process."""
        log = self.folder / f"{who}.txt"
        return log.read_text().count(line) if log.exists() else 0

    def await_leaving(self, workers: Iterable[str]) -> None:
        """Return when the run knows that these workers are gone."""
        for name in workers:
            self.wait_until(partial(self._knows, name, False), f"{name} leaves")

    def await_answers(self, workers: Iterable[str]) -> None:
        """Return when each of these workers has joined, has done new batches, and has answered.

        Three batches: a worker has at most two requests, and gets no more until one is answered.
        """
        for name in workers:
            self.wait_until(partial(self._knows, name, True), f"{name} joins")
            self.await_batches(name, 3)

    def await_batches(self, worker: str, more: int) -> None:
        """Return when a worker has done so many more batches."""
        enough = self.count(worker, DONE) + more
        self.wait_until(lambda: self.count(worker, DONE) >= enough, f"{worker} works")

    def await_progress(self) -> None:
        """Return when the run has recorded frames more."""
        before = recorded(self.run)
        self.wait_until(lambda: recorded(self.run) > before, "a frame is recorded")

    def wait_until(self, happened: Callable[[], bool], what: str) -> None:
        """Return when something has happened, while the run goes on."""
        deadline = time.monotonic() + PATIENCE
        while not happened():
            assert "coordinator" not in self.processes or self.processes["coordinator"].is_alive(), (
                f"the run ended before: {what}\n{self.story()}"
            )
            assert time.monotonic() < deadline, f"waited in vain until {what}\n{self.story()}"
            time.sleep(0.01)

    def finish(self) -> dict[str, Any]:
        """Wait for the end of the run; gives its summary."""
        process = self.processes["coordinator"]
        process.join(PATIENCE)
        assert process.exitcode == 0, self.story()
        summary: dict[str, Any] = json.loads((self.run / "summary.json").read_text())
        return summary

    def story(self) -> str:
        """The logs of all processes."""
        return "\n".join(f"{path.name}:\n{path.read_text()}" for path in sorted(self.folder.glob("*.txt")))

    def _knows(self, worker: str, there: bool) -> bool:
        joined, left = (self.count("coordinator", f"worker {worker} {what}") for what in ("joined", "left"))
        return (joined > left) is there

    def _start(self, name: str, do: Callable[..., None], *arguments: object) -> None:
        log = self.folder / f"{name}.txt"
        self.processes[name] = self.hosts[name].start(do, *arguments, log=log)


@contextmanager
def site(calm: Path, folder: Path) -> Iterator[Site]:
    """Hosts, and on them a run that has begun; nothing runs on them afterwards."""
    try:
        network = Network()
    except NotAllowed as error:
        pytest.skip(f"no network hosts can be made here: {error}")
    with network:
        site = Site(network, calm.parent / "sequence", folder)
        try:
            site.start_all()
            yield site
        finally:
            for name in list(site.processes):
                site.end(name)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undisturbed run of the sequence, with one worker on the same host."""
    place = Place(tmp_path_factory.mktemp("hosts"), FRAMES)
    with place.workers(w0=1):
        place.finish(place.folder / "calm")
    return place.folder / "calm"


def assert_same(site: Site, calm: Path) -> dict[str, Any]:
    """The run ends, and its track has the bytes of the calm one; gives its summary."""
    summary = site.finish()
    assert (site.run / "track.npz").read_bytes() == (calm / "track.npz").read_bytes()
    assert summary["frames"] == FRAMES
    return summary


def test_a_worker_whose_cable_is_pulled_and_put_back_is_given_work_again(calm: Path, tmp_path: Path) -> None:
    """Three workers take part, sharing no memory; the work of one is sent to the others, which continue.

    It takes part again: no byte changes.
    """
    with site(calm, tmp_path) as hosts:
        hosts.network.pull(hosts.hosts["w0"])
        hosts.await_leaving(["w0"])
        hosts.await_progress()
        hosts.network.put_back(hosts.hosts["w0"])
        hosts.await_answers(["w0"])
        summary = assert_same(hosts, calm)
        assert summary["batches_sent_again"] > 0
        assert summary["workers_seen"] == list(WORKERS)


@pytest.mark.parametrize("host", ["coordinator", "router"])
def test_a_run_waits_while_it_is_cut_off_from_all_workers(calm: Path, tmp_path: Path, host: str) -> None:
    """The coordinator's cable is pulled and put back, or the router's; all find each other again."""
    with site(calm, tmp_path) as hosts:
        hosts.network.pull(hosts.hosts[host])
        hosts.await_leaving(WORKERS)
        before = recorded(hosts.run)
        time.sleep(1.0)
        assert recorded(hosts.run) == before
        hosts.network.put_back(hosts.hosts[host])
        hosts.await_answers(WORKERS)
        assert assert_same(hosts, calm)["batches_sent_again"] > 0


def test_a_router_that_is_started_again_changes_no_byte(calm: Path, tmp_path: Path) -> None:
    """Killed in mid-run; all find each other at the new one."""
    with site(calm, tmp_path) as hosts:
        first = hosts.processes["router"].pid
        hosts.end("router")
        hosts.await_leaving(WORKERS)
        hosts.start_router()
        hosts.await_answers(WORKERS)
        assert hosts.processes["router"].pid != first
        assert assert_same(hosts, calm)["batches_sent_again"] > 0
        assert hosts.processes["router"].is_alive()
