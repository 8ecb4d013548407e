"""A `gepf-worker` whose kernel is simple arithmetic: `python -m tests.support.processes.instant_worker`."""

from __future__ import annotations

import math
import os
import signal
import time
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from gepf.common.body import BodyModel
from gepf.common.cores import usable_cores
from gepf.common.frame import SubjectFrame
from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import RefineSettings
from gepf.worker import cli

DISTURBANCES = "DISTURBANCES"  # environment variable: a folder
_requests = count()


def disturb(folder: Path, number: signal.Signals) -> None:
    """Have the next process with this folder, after its first request, get a signal within another one."""
    (folder / f"{time.monotonic_ns()}.{number.name}").touch()


def suffer() -> None:
    """Signal this process, if it has been told to."""
    if DISTURBANCES in os.environ and next(_requests) > 0:
        for told in Path(os.environ[DISTURBANCES]).iterdir():
            told.unlink()
            os.kill(os.getpid(), signal.Signals[told.suffix[1:]])
            return


def observe(subject: SubjectFrame, settings: RefineSettings | None = None) -> float:
    """Mean depth of the picked pixels, for any settings."""
    del settings
    return float(subject.largest.image.metres().ravel()[subject.largest.picked].mean())


def refine(model: BodyModel, observation: float, particles: Particles, lanes: int = 1) -> Refined:
    """Something that depends on all that a result may depend on, particle by particle."""
    suffer()
    poses = particles.poses
    time.sleep(float(os.environ.get("SECONDS_PER_PARTICLE", "0")) * math.ceil(len(poses) / lanes))
    moved = np.sin(poses * particles.settings.damping + observation) + model.vertices.sum()
    roots = np.abs(np.sin(moved[:, :1])) * np.tri(moved.shape[1])[np.tri(moved.shape[1]) > 0.0]
    return Refined(
        moved,
        -np.abs(moved).sum(axis=1),
        np.abs(moved - poses).mean(axis=1),
        (0.1 * roots).astype(np.float32) if particles.covariance else None,
    )


KERNEL = Kernel(observe, refine)


def load_kernel(lanes: int | None) -> Kernel:
    """In place of the compiled kernel."""
    lanes = lanes or usable_cores()
    return Kernel(observe, partial(refine, lanes=lanes), Offer(lanes=lanes))


def main() -> None:
    """`gepf-worker` with this kernel."""
    vars(cli)["load_kernel"] = load_kernel
    cli.main()


if __name__ == "__main__":
    main()
