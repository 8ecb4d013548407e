"""The worker's kernel, compiled and loaded by importing this."""

from __future__ import annotations

from worker.cli import load_kernel

KERNEL = load_kernel()
