"""The health check of a worker: by its liveliness token, and as a process of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

from common.errors import BusError
from common.transport.opening import open_coordinator
from tests.support.processes.serving import serving
from worker.connection import Identity, check_alive


def test_a_worker_is_healthy_as_long_as_it_is_announced(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is seen while it is at work, under its own name only, and no more once it has ended."""
    with open_coordinator([endpoint]):
        with serving(endpoint, "w"):
            check_alive(Identity("w", (endpoint,)))
            monkeypatch.setattr("worker.connection.SEEN_WITHIN_S", 0.5)
            with pytest.raises(BusError, match="worker 'v' is not seen at unixsock"):
                check_alive(Identity("v", (endpoint,)))
        with pytest.raises(BusError, match="'w' is not seen"):
            check_alive(Identity("w", (endpoint,)))


@pytest.mark.slow
def test_the_command_says_so_by_its_exit_code(endpoint: str) -> None:
    """`gepf-worker --check` for a worker that is not there: 1 and one line."""
    command = [sys.executable, "-m", "worker.cli", "--connect", endpoint, "--name", "v", "--check"]
    with open_coordinator([endpoint]):
        done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode, done.stderr) == (1, f"gepf-worker: worker 'v' is not seen at {endpoint}\n")
