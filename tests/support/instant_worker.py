"""A `gepf-worker` whose kernel is simple arithmetic: `python -m tests.support.instant_worker`."""

from __future__ import annotations

import os
import time

import numpy as np
import typer
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from common.transport.credentials import read_credentials
from worker.cli import Connect, Name, Tied, TlsCa, TlsCert, TlsKey, choose_identity, exit_with, serve
from worker.service import Kernel


def observe(subject: SubjectFrame) -> float:
    """Mean depth of the picked pixels."""
    return float(subject.frame.metres().ravel()[subject.picked].mean())


def refine(
    model: BodyModel, observation: float, poses: NDArray[np.float64], settings: RefineSettings
) -> Refined:
    """Something that depends on all that a result may depend on, particle by particle."""
    time.sleep(float(os.environ.get("SECONDS_PER_PARTICLE", "0")) * len(poses))
    moved = np.sin(poses * settings.damping + observation) + model.vertices.sum()
    return Refined(moved, -np.abs(moved).sum(axis=1), np.abs(moved - poses).mean(axis=1))


KERNEL = Kernel(observe, refine)


def work(
    connect: Connect,
    *,
    name: Name = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    tied: Tied = False,
) -> None:
    """As `gepf-worker` does."""

    def job() -> None:
        identity = choose_identity(connect, name, read_credentials(tls_ca, tls_cert, tls_key))
        serve(identity, lambda: KERNEL, tied=tied)

    exit_with(job)


if __name__ == "__main__":
    typer.run(work)
