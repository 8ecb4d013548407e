"""The command `gepf`.

What another program would read goes to stdout, all else to stderr. Exit codes: 0 done, 2 the user's input
is at fault (one line on stderr), 3 done, but most frames were not tracked, 130 interrupted, 1 anything
else. What takes long to load is imported by the command that needs it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for small matrices, more only take cores from workers

from coordinator.cli.application import app, main

__all__ = ["app", "main"]
