"""Coordinator, router and three workers, each a network host of its own, on a network that fails."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest

from tests.network import Network, NotAllowed
from tests.small_sequence import write_small_sequence
from tests.warm_processes import Workers, coordinate, start, work

pytestmark = pytest.mark.slow

FRAMES = 60
WORKERS = ("w0", "w1", "w2")
PATIENCE = 60.0  # seconds for whatever must happen
PORT = 7447


def route(address: str) -> None:
    """`gepf router`."""
    from coordinator.cli import main

    main(["router", "--listen", f"tcp/{address}:{PORT}", "--insecure"])


class Site:
    """Processes on hosts of their own, and the run that they are at."""

    def __init__(self, network: Network, sequence: Path, folder: Path, **cable: float) -> None:
        self.network = network
        self.sequence = sequence
        self.folder = folder
        self.hosts = {name: network.host(name) for name in ("coordinator", "router")}
        self.hosts |= {name: network.host(name, **cable) for name in WORKERS}
        self.endpoint = f"tcp/{self.hosts['router'].address}:{PORT}"
        self.processes: dict[str, BaseProcess] = {}

    def start_router(self) -> None:
        """Let all meet."""
        self._start("router", route, self.hosts["router"].address)

    def start_all(self) -> None:
        """The router, the workers and the run."""
        self.start_router()
        for name in WORKERS:
            self._start(name, work, (self.endpoint,), name)
        own = f"unixsock-stream/{self.folder}/bus"  # where nobody connects
        self._start("coordinator", coordinate, self.sequence, self.run, own, "--connect", self.endpoint)

    def end(self, name: str) -> None:
        """End a process, at once."""
        process = self.processes.pop(name)
        process.kill()
        process.join()

    @property
    def run(self) -> Path:
        """The folder of the run."""
        return self.folder / "run"

    def said(self, line: str) -> int:
        """How often the coordinator has said something."""
        log = self.folder / "coordinator.txt"
        return log.read_text().count(line) if log.exists() else 0

    def await_run(self) -> None:
        """Return when all workers are at work and frames are being recorded."""
        log = self.run / "frames.log"
        self.wait_until(lambda: all(self.said(f"worker {name} joined") for name in WORKERS), "all join")
        self.wait_until(log.exists, "the run begins")
        begun = log.stat().st_size
        self.wait_until(lambda: log.stat().st_size > begun, "frames are recorded")

    def wait_until(self, happened: Callable[[], object], what: str) -> None:
        """Return when something has happened, while the run goes on."""
        deadline = time.monotonic() + PATIENCE
        while not happened():
            assert self.processes["coordinator"].is_alive(), f"the run ended before: {what}\n{self.story()}"
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
        """What all have said."""
        return "\n".join(f"{path.name}:\n{path.read_text()}" for path in sorted(self.folder.glob("*.txt")))

    def _start(self, name: str, do: Callable[..., None], *arguments: object) -> None:
        log = self.folder / f"{name}.txt"
        self.processes[name] = self.hosts[name].start(do, *arguments, log=log)


@contextmanager
def site(calm: Path, folder: Path, **cable: float) -> Iterator[Site]:
    """Hosts with nothing running on them yet; nothing runs on them afterwards."""
    with network_or_skip(folder / "cables.txt") as network:
        site = Site(network, calm.parent / "sequence", folder, **cable)
        try:
            yield site
        finally:
            for name in list(site.processes):
                site.end(name)


@contextmanager
def network_or_skip(log: Path) -> Iterator[Network]:
    """A network, where that is allowed."""
    try:
        with Network(log) as network:
            yield network
    except NotAllowed as error:
        pytest.skip(f"no network hosts can be made here: {error}")


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calm run of the sequence beside it, with one worker of the same host."""
    folder = tmp_path_factory.mktemp("hosts")
    write_small_sequence(folder / "sequence", FRAMES)
    endpoint = f"unixsock-stream/{folder}/bus"
    with Workers((endpoint,), folder / "worker.txt") as workers:
        workers.start("w0")
        run = start(coordinate, folder / "sequence", folder / "calm", endpoint, log=folder / "log.txt")
        run.join()
    assert run.exitcode == 0, (folder / "log.txt").read_text()
    return folder / "calm"


def assert_same(site: Site, calm: Path) -> None:
    """The run's track has the bytes of the calm one."""
    assert (site.run / "track.npz").read_bytes() == (calm / "track.npz").read_bytes()


def test_a_run_across_hosts_has_the_bytes_of_a_local_one(calm: Path, tmp_path: Path) -> None:
    """All three workers take part, through the router, sharing no memory."""
    with site(calm, tmp_path) as hosts:
        hosts.start_all()
        summary = hosts.finish()
        assert_same(hosts, calm)
        assert set(summary["workers_seen"]) <= set(WORKERS)
        assert summary["frames"] == FRAMES


@pytest.mark.parametrize("host", ["w0", "coordinator", "router"])
def test_a_cable_that_is_pulled_and_put_back_changes_no_byte(calm: Path, tmp_path: Path, host: str) -> None:
    """A worker's, while the others go on; the coordinator's and the router's, while nobody can."""
    with site(calm, tmp_path) as hosts:
        hosts.start_all()
        hosts.await_run()
        hosts.network.pull(hosts.hosts[host])
        lost = ("w0",) if host == "w0" else WORKERS
        hosts.wait_until(lambda: all(hosts.said(f"worker {name} left") for name in lost), "workers leave")
        hosts.network.put_back(hosts.hosts[host])
        hosts.wait_until(
            lambda: all(hosts.said(f"worker {name} joined") > 1 for name in lost), "they are back"
        )
        summary = hosts.finish()
        assert_same(hosts, calm)
        assert summary["batches_sent_again"] > 0


def test_a_network_that_loses_and_delays_packets_changes_no_byte(calm: Path, tmp_path: Path) -> None:
    """5 % loss and 20 ms delay on the cable of each worker, either way."""
    with site(calm, tmp_path, loss=0.05, delay=0.02) as hosts:
        hosts.start_all()
        hosts.finish()
        assert_same(hosts, calm)


def test_a_router_that_is_started_again_changes_no_byte(calm: Path, tmp_path: Path) -> None:
    """Killed in mid-run; all find each other at the new one."""
    with site(calm, tmp_path) as hosts:
        hosts.start_all()
        hosts.await_run()
        hosts.end("router")
        hosts.wait_until(lambda: all(hosts.said(f"worker {name} left") for name in WORKERS), "workers leave")
        hosts.start_router()
        hosts.wait_until(
            lambda: all(hosts.said(f"worker {name} joined") > 1 for name in WORKERS), "they are back"
        )
        hosts.finish()
        assert_same(hosts, calm)
