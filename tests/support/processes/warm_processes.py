"""Real processes that start fast: forked from one that has loaded all modules and opened no bus."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import MappingProxyType

from gepf.common.closing import Closing

CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(
    [
        "tests.support.processes.bare_gepf",
        "tests.support.processes.instant_worker",
        "tests.support.kernel.warm_kernel",
    ]
)


def start(do: Callable[..., None], *arguments: object, log: Path) -> BaseProcess:
    """A process that does something; its standard error goes to a file."""
    process = CONTEXT.Process(target=run, args=(do, arguments, log))
    process.start()
    return process


@contextmanager
def started(do: Callable[..., None], *arguments: object, log: Path) -> Iterator[BaseProcess]:
    """The same; it is killed if it is left running."""
    process = start(do, *arguments, log=log)
    try:
        yield process
    finally:
        process.kill()
        process.join()


def run(do: Callable[..., None], arguments: tuple[object, ...], log: Path) -> None:
    """The body of every process: standard error goes to the file."""
    os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND), 2)
    do(*arguments)


def end(process: BaseProcess, number: signal.Signals = signal.SIGINT, seconds: float = 300.0) -> int | None:
    """The exit code of a process after a signal; None if it goes on."""
    assert process.pid is not None
    os.kill(process.pid, number)
    process.join(seconds)
    return process.exitcode


def coordinate(sequence: Path, out: Path, endpoint: str, *options: str) -> None:
    """`gepf track`."""
    from tests.support.processes.bare_gepf import track

    sys.exit(track(sequence, out, endpoint, *options))


def gepf(*words: str) -> None:
    """`gepf` with these words."""
    from gepf.coordinator.cli import main

    sys.exit(main(words))


def work(endpoints: tuple[str, ...], name: str, lanes: int = 1) -> None:
    """`gepf-worker`."""
    from gepf.worker.cli import exit_with, serve
    from gepf.worker.connection import Identity
    from tests.support.kernel.warm_kernel import kernel_on

    exit_with(lambda: serve(Identity(name, endpoints), lambda: kernel_on(lanes)))


def work_instantly(*arguments: str) -> None:
    """`gepf-worker` with these arguments, whose kernel is simple arithmetic."""
    from tests.support.processes.instant_worker import main

    sys.argv[1:] = arguments
    main()


class Workers(Closing):
    """Worker processes by name, each of which can be killed, frozen, and started again; a context manager."""

    def __init__(
        self, endpoints: tuple[str, ...], log: Path, lanes: Mapping[str, int] = MappingProxyType({})
    ) -> None:
        self._endpoints = endpoints
        self._log = log
        self._lanes = lanes  # by name; one for who is not named
        self._processes: dict[str, list[BaseProcess]] = {}

    def close(self) -> None:
        """Kill all."""
        for name in list(self._processes):
            self.kill(name)

    def start(self, name: str) -> None:
        """Start a worker; one of the same name may be there already."""
        self._processes.setdefault(name, []).append(
            start(work, self._endpoints, name, self._lanes.get(name, 1), log=self._log)
        )

    def kill(self, name: str) -> None:
        """Kill all workers of a name at once."""
        for process in self._processes.pop(name, []):
            process.kill()
            process.join()

    def freeze(self, name: str) -> None:
        """Stop all workers of a name until they are thawed."""
        self._signal(name, signal.SIGSTOP)

    def thaw(self, name: str) -> None:
        """Let them go on."""
        self._signal(name, signal.SIGCONT)

    def _signal(self, name: str, number: signal.Signals) -> None:
        for process in self._processes.get(name, []):
            if process.pid is not None:
                with suppress(ProcessLookupError):
                    os.kill(process.pid, number)
