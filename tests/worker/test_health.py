"""The health check of a worker: by its liveliness token, from a process of its own."""

from __future__ import annotations

import subprocess
import sys

from common.transport.bus import open_coordinator
from tests.support.serving import serving


def check(endpoint: str, name: str) -> subprocess.CompletedProcess[str]:
    """`gepf-worker --check`."""
    command = [sys.executable, "-m", "worker.cli", "--connect", endpoint, "--name", name, "--check"]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)


def test_a_worker_is_healthy_as_long_as_it_is_announced(endpoint: str) -> None:
    """Exit code 0 for a worker at work, 1 with one line for another name and after it has ended."""
    with open_coordinator([endpoint]):
        with serving(endpoint, "w"):
            assert check(endpoint, "w").returncode == 0
            other = check(endpoint, "v")
            assert other.returncode == 1
            assert other.stderr == f"gepf-worker: worker 'v' is not seen at {endpoint}\n"
        assert check(endpoint, "w").returncode == 1
