"""The command `gepf`.

Output for programs goes to stdout, everything else to stderr. Exit codes: 0 done, 2 wrong input of the user
(one line on stderr), 3 done, but most frames were not tracked, 130 interrupted, 1 any other error. Modules
that are slow to load are imported by the commands that need them.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for small matrices, more only take cores from workers

from gepf.coordinator.cli.application import main
from gepf.coordinator.cli.commands import app

__all__ = ["app", "main"]
