"""Processes and threads to test with, and how to wait for them."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

INSTANT = (sys.executable, "-m", "tests.support.processes.instant_worker")
CACHE = "NUMBA_CACHE_DIR"
GEPF = (sys.executable, "-m", "gepf.coordinator.cli")
WORKER = (sys.executable, "-m", "gepf.worker.cli")


def is_alive(pid: int) -> bool:
    """Whether a process runs; a zombie does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def wait_until(condition: Callable[[], bool], seconds: float = 300.0) -> None:
    """Poll until the condition holds; fail if it does not within the time."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


@contextmanager
def started(*arguments: str, command: tuple[str, ...] = WORKER) -> Iterator[subprocess.Popen[str]]:
    """A process with its standard error in a pipe; killed if it is left running."""
    with subprocess.Popen(
        [*command, *arguments], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def fresh_python(root: Path, code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Code run with the packages in a folder, which keep compiled kernels where they do by themselves."""
    clean = {name: value for name, value in os.environ.items() if name != CACHE}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env={**clean, "PYTHONPATH": str(root), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@contextmanager
def in_thread(act: Callable[[threading.Event], None]) -> Iterator[None]:
    """Something that goes on beside the body until it is stopped."""
    stop = threading.Event()
    thread = threading.Thread(target=act, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(300.0)
