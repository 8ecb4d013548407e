"""Messages about connections: endpoint, no answer, router lost, router back; real processes."""

from __future__ import annotations

import subprocess
from contextlib import ExitStack
from pathlib import Path

from tests.support.processes.certificates import free_port
from tests.support.processes.programs import WORKER, wait_until
from tests.support.processes.warm_processes import end, gepf, started, work
from tests.support.small_sequence import OPTIONS, write_small_sequence

LONG = 300.0  # seconds: the machine may be busy, and kernels may have to be compiled


def test_a_worker_speaks_while_nobody_answers_and_gives_up() -> None:
    """`gepf-worker --connect-timeout`: the endpoint, that it waits, and at the end exit code 1."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = subprocess.run(
        [*WORKER, "--connect", endpoint, "--connect-timeout", "5"],
        capture_output=True,
        text=True,
        check=False,
        timeout=LONG,
    )
    assert done.returncode == 1
    for says in (
        f"loading, before connecting to {endpoint}; the first time this takes a minute",
        f"connecting to {endpoint}\n",
        f"no answer at {endpoint} yet; retrying",
        f"no answer at {endpoint} within 5 s; start the coordinator there",
    ):
        assert says in done.stderr


def test_a_router_that_went_is_named_by_run_and_worker(tmp_path: Path) -> None:
    """Killed and started again: a line for each on both sides, and the run continues."""
    write_small_sequence(tmp_path / "seq", 400)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    logs = {name: tmp_path / f"{name}.log" for name in ("router", "run", "worker")}
    router = ("router", "--listen", endpoint)
    track = ("track", str(tmp_path / "seq"), "--out", str(tmp_path / "out"), *OPTIONS, "--no-pictures")
    alone = ("--workers", "0", "--connect", endpoint)

    def says(name: str, line: str) -> bool:
        return logs[name].exists() and line in logs[name].read_text()

    with ExitStack() as stack:
        first = stack.enter_context(started(gepf, *router, log=logs["router"]))
        run = stack.enter_context(started(gepf, *track, *alone, log=logs["run"]))
        wait_until(lambda: says("run", "no worker is connected"), LONG)
        first.kill()
        wait_until(lambda: says("run", f"{endpoint} is gone; trying to reach it again"), LONG)
        worker = stack.enter_context(started(work, (endpoint,), "w", log=logs["worker"]))
        wait_until(lambda: says("worker", f"no answer at {endpoint} yet"), LONG)
        second = stack.enter_context(started(gepf, *router, log=logs["router"]))
        wait_until(lambda: says("run", f"{endpoint} is back"), LONG)
        wait_until(lambda: says("run", "joined"), LONG)
        second.kill()
        wait_until(lambda: says("worker", f"{endpoint} is gone; trying to reach it again"), LONG)
        for process, code in ((run, 130), (worker, 0)):
            assert end(process, seconds=LONG) == code
