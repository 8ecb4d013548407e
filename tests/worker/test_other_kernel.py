"""A kernel for other hardware is a package of its own, which needs nothing of ours but the port."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from gepf.common.errors import ProtocolError
from gepf.common.offer import Offer
from gepf.common.protocol import keys
from tests.support.processes.programs import WORKER, started
from tests.support.processes.serving import MODEL, PARTICLES, frame, pool

CODE = """
import sys
import numpy as np
from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.common.refinement import Refined

def load(lanes):
    def refine(model, seen, particles):
        assert "gepf.worker.kernel" not in sys.modules
        zeros = np.zeros(len(particles.poses))
        return Refined(particles.poses + 1.0, zeros, zeros)
    return Kernel(lambda *_: None, refine, Offer("toy", "toy-1", lanes or 2, 16))
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package `toy` with a kernel."""
    (tmp_path / "toy.py").write_text(CODE)
    info = tmp_path / "toy-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[gepf.kernels]\ntoy = toy:load\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))


@pytest.mark.usefixtures("toy")
@pytest.mark.parametrize("lanes", [None, 3])
def test_a_worker_serves_with_the_kernel_of_another_package(lanes: int | None, endpoint: str) -> None:
    """A real `gepf-worker --kind toy` serves a run of this kind, with its lanes, processor and results."""
    options = [] if lanes is None else ["--lanes", str(lanes)]
    with (
        pool(endpoint, kind="toy") as refiner,
        started("--connect", endpoint, "--kind", "toy", "--name", "w", *options),
    ):
        refined = refiner.submit(frame(1), MODEL, PARTICLES).result()
        assert (refined.poses == PARTICLES.poses + 1.0).all()
        assert refiner.statistics.processors == ("toy-1",)
        (worker,) = refiner._client.scheduler.workers.values()
        assert (worker.offer.lanes, worker.offer.slots) == (lanes or 2, (lanes or 2) * 16)


@pytest.mark.usefixtures("toy")
def test_a_kind_that_is_not_installed_is_refused_in_one_line(endpoint: str) -> None:
    """With the kinds that are."""
    with started("--connect", endpoint, "--kind", "cuda", command=WORKER) as process:
        _, err = process.communicate(timeout=300.0)
    assert process.returncode == 2
    assert err.splitlines()[-1] == (
        "gepf-worker: no kernel of kind 'cuda' is installed; install its package, or give cpu, toy"
    )


def test_an_offer_that_is_none_is_not_read() -> None:
    """Another version's or a hostile token is refused with its key; a valid one comes out as it went in."""
    for what in ("alive", "offer/cpu/any/0/1", "offer/cpu/any/1", "offer/cpu/any/1/x", "offer/a/b/1/99999"):
        with pytest.raises(ProtocolError, match="is not an offer"):
            keys.read_offer(keys.of_worker("w", what))
    offer = Offer("cuda", "sm-90", 2, 64)
    assert keys.read_offer(keys.offer_key("w", offer)) == offer
