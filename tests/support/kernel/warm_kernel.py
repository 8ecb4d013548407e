"""The worker's kernel, compiled and loaded by importing this."""

from __future__ import annotations

from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.worker.cli import load_kernel
from gepf.worker.lanes import Lanes

KERNEL = load_kernel(1)


def kernel_on(lanes: int) -> Kernel:
    """The kernel on lanes of this process: threads of a process do not live on in those forked from it."""
    return Kernel(KERNEL.observe, Lanes(lanes).refine, Offer(lanes=lanes))
