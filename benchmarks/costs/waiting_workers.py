"""A worker whose lanes wait instead of computing: python -m benchmarks.costs.waiting_workers.

A result is the particle itself. A coordinator sees no difference from a real worker.
"""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time

from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import RefineSettings
from gepf.common.transport.opening import open_worker
from gepf.coordinator.tracking.warm_up import unmoved
from gepf.worker.service import Service


def waiting(seconds: float, lanes: int) -> Kernel:
    """A kernel that waits for a time for each particle of a lane, without computing."""

    def observe(subject: SubjectFrame, settings: RefineSettings) -> None:
        del subject, settings

    def refine(model: BodyModel, seen: None, particles: Particles) -> Refined:
        del model, seen
        if seconds > 0.0:
            time.sleep(seconds * math.ceil(len(particles.poses) / lanes))
        return unmoved(particles)

    return Kernel(observe, refine, Offer(lanes=lanes))


def serve(endpoint: str, name: str, kernel: Kernel) -> None:
    """Serve until the coordinator has ended."""
    with open_worker((endpoint,)) as bus:
        Service(bus, name, kernel).run()


def main() -> None:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--name", default="waiting")
    parser.add_argument("--lanes", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--tied", action="store_true")
    chosen = parser.parse_args()
    kernel = waiting(chosen.seconds, chosen.lanes)
    threading.Thread(target=serve, args=(chosen.connect, chosen.name, kernel), daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    main()
