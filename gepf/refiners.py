"""Chooses where a library tracker refines particles: in this process, a local worker, or other workers.

Errors about endpoints and certificates name the library's arguments instead of command-line options.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import lru_cache

from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.common.frame import SubjectFrame
from gepf.common.recent import FRAMES_KEPT
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.security.access import TlsFiles, choose_security
from gepf.coordinator.tracking.refiner import LocalRefiner, Refiner
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import observe

log = logging.getLogger("gepf")

Workers = int | str | Pool

IN_PYTHON = {
    "--tls-ca, --tls-cert and --tls-key": "tls=TlsFiles(ca, cert, key)",
    "--tls-": "tls.",
    "--listen ": "listen=",
    "--connect ": "connect=",
}


def open_refiner(workers: Workers | None, tls: TlsFiles | None, stack: ExitStack) -> Refiner:
    """Open a refiner that `stack` closes; InputError for a pool that no worker could join."""
    if workers is None:
        return DirectRefiner()
    if isinstance(workers, int):
        if workers < 1:
            raise InputError(f"workers={workers} would refine nothing; give None, 1 or more, or a Pool")
        pool = Pool(workers)
    else:
        pool = Pool(0, connect=workers) if isinstance(workers, str) else workers
        if pool.security is None or tls is not None:
            with said_in_python("workers=Pool(0, listen, connect, insecure=True)"):
                security = choose_security(
                    pool.listen, pool.connect, tls or TlsFiles(), insecure=pool.insecure
                )
            pool = replace(pool, security=security)
    with said_in_python():
        return stack.enter_context(ZenohRefiner(pool, log.info))


@contextmanager
def said_in_python(insecure: str = "insecure=True") -> Iterator[None]:
    """In the messages of InputErrors, replace command-line options by the library's arguments."""
    try:
        yield
    except InputError as error:
        line = str(error)
        for option, name in {**IN_PYTHON, "--insecure": insecure}.items():
            line = line.replace(option, name)
        raise InputError(line) from error


class DirectRefiner(LocalRefiner):
    """Refines with the worker's kernel, on one core."""

    def __init__(self) -> None:
        self._observe = lru_cache(FRAMES_KEPT)(observe)

    def refine(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Refined:
        """Refine particles on a frame."""
        return refine(model, self._observe(subject), particles)
