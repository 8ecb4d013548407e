"""Many workers in one process that only wait the kernel's time: python -m benchmarks.waiting_workers.

A result is the particle itself. Each worker has a session, a name and a queue of its own, as `gepf-worker`
has; so a coordinator cannot tell them from real ones.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from common.transport.bus import open_worker
from worker.service import Kernel, Service


def waiting(seconds: float) -> Kernel[None]:
    """A kernel that takes so long for each particle, without computing."""

    def observe(subject: SubjectFrame) -> None:
        del subject

    def refine(
        model: BodyModel, observation: None, poses: NDArray[np.float64], settings: RefineSettings
    ) -> Refined:
        del model, observation, settings
        if seconds > 0.0:
            time.sleep(seconds * len(poses))
        return Refined(poses, -np.abs(poses).sum(axis=1), np.zeros(len(poses)))

    return Kernel(observe, refine)


def serve(endpoint: str, name: str, seconds: float) -> None:
    """One worker, until the coordinator is gone."""
    with open_worker((endpoint,)) as bus:
        Service(bus, name, waiting(seconds)).run()


def main() -> None:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--name", default="waiting")
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--tied", action="store_true")
    chosen = parser.parse_args()
    for k in range(chosen.count):
        name = chosen.name if chosen.count == 1 else f"{chosen.name}-{k}"
        threading.Thread(target=serve, args=(chosen.connect, name, chosen.seconds), daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    main()
